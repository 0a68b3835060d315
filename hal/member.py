"""One of several hardware components: what the loop knows of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from hal.lifecycle import Hardware, LifecycleState

CONFIGURED = (LifecycleState.INACTIVE, LifecycleState.ACTIVE)


@dataclass(slots=True)
class Member:
    """One component, and which part of the whole it is."""

    hardware: Hardware
    joints: slice
    commands: slice
    every: int = 1
    """It is read and written in every so many-th cycle."""
    away: bool = False
    """Somebody changes its state just now: the cycle leaves it alone."""
    error: Exception | None = None
    """Why it is lost, or by what defect. It may still be told to stop, as far as it can be reached."""
    out_of_reach: bool = False
    """The last command reached nobody."""
    finalized: bool = False
    driven: bool = False
    """It has been active in a cycle, and nobody has changed its state since."""

    @property
    def name(self) -> str:
        return self.hardware.name

    @property
    def state(self) -> LifecycleState:
        """As the component says; FINALIZED, which comes from outside, is the last word."""
        return LifecycleState.FINALIZED if self.finalized else self.hardware.state

    @property
    def sound(self) -> bool:
        """Whether the cycle may read it: it is configured, at home and not lost."""
        return not self.away and self.error is None and self.hardware.state in CONFIGURED

    @property
    def active(self) -> bool:
        """Whether controllers may command it."""
        return self.sound and self.hardware.state is LifecycleState.ACTIVE


def members_of(hardware: Sequence[Hardware], every: Sequence[int]) -> Iterator[Member]:
    """One behind the other; ``every``: in every how many-th cycle each is read and written."""
    joints = commands = 0
    for one, cycles in zip(hardware, every, strict=True):
        ends = joints + len(one.joints), commands + len(one.command_interfaces)
        yield Member(one, slice(joints, ends[0]), slice(commands, ends[1]), cycles)
        joints, commands = ends


def absence(member: Member) -> str:
    """Why there is nothing new of a component's joints."""
    if member.error is not None:
        return f"{member.name} is lost: {member.error}"
    return f"{member.name} is {'being switched' if member.away else member.state.name.lower()}"
