"""Terminal user interface of teleoperation: follower state, joints of both arms, and faults."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from typing import Self

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from controller.teleop.leader_follower_controller import FollowerPhase
from hal.servos.leader_arm import leader_joint
from servoloop.manual.dead_man import Keys
from servoloop.manual.live_table import LiveTable
from servoloop.teleop.arms import Teleop
from servoloop.teleop.attendance import HINT

STYLES = {FollowerPhase.HOLDING: "yellow", FollowerPhase.JOINING: "cyan", FollowerPhase.FOLLOWING: "green"}


class TeleopScreen(LiveTable):
    """Terminal user interface with questions, a dead-man key and a live table of both arms."""

    summary = ""
    """Statistics to print when the teleoperation ends."""

    def __init__(
        self,
        console: Console,
        keys: Callable[[], AbstractContextManager[Keys]],
        confirm: Callable[[str], None],
        hint: str = HINT,
    ) -> None:
        """Create the user interface.

        Args:
            console: Terminal console.
            keys: Context in which keys are read from the terminal.
            confirm: Function that asks a question and raises an error unless the answer is yes.
            hint: Instruction for enabling torque again.
        """
        super().__init__(console)
        self.console, self.confirm, self.hint = console, confirm, hint
        self._open_keys = keys
        self._keys: Keys | None = None
        self._entered = ExitStack()

    def __enter__(self) -> Self:
        self._keys = self._entered.enter_context(self._open_keys())
        return super().__enter__()

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._entered.close()

    def allowed(self, now_s: float) -> bool:
        """Return whether the follower may move now."""
        return self._keys is not None and self._keys.allowed(now_s)

    def ended(self) -> bool:
        """Return whether the user wants to stop teleoperation."""
        return self._keys is not None and self._keys.ended()

    def commands(self) -> Sequence[str]:
        """Return the command keys pressed since the last call."""
        return () if self._keys is None else self._keys.commands()

    def show(self, both: Teleop, notes: Sequence[str] = ()) -> None:
        """Display the current state."""
        self.summary = f"{both.loop.figures.summary}; {both.latency.summary}"
        phase = both.controller.phase
        self.draw("; ".join([status_line(both), *notes]), lambda: Group(Text(phase, style=STYLES[phase]), _table(both)))


def status_line(both: Teleop) -> str:
    """Return the follower's state and all problems in one line."""
    controller, state = both.controller, both.latency.state
    faults = [fault.text for fault in state.faults.values() if fault.text != controller.reason] if state else []
    reasons = [reason for reason in (controller.reason, *dict.fromkeys(faults), *controller.beyond.values()) if reason]
    return "; ".join([controller.phase, *reasons])


def _table(both: Teleop) -> Table:
    """Return a table of both arms. The error is relative to the leader's position, even if that position is outside the
    follower's limits."""
    table = Table("joint", "leader", "follower", "error")
    for joint, leader, follower, error in rows(both):
        state, red = both.latency.state, joint in both.controller.beyond
        red |= state is not None and (joint in state.faults or leader_joint(joint) in state.faults)
        table.add_row(joint, *(f"{value:+.3f}" for value in (leader, follower, error)), style="red" if red else "")
    return table


def rows(both: Teleop) -> list[tuple[str, float, float, float]]:
    """Return each joint with the leader position, the follower position and the follower's error."""
    state, controller = both.latency.state, both.controller
    if state is None:
        return []
    position = dict(zip(both.loop.hardware.joints, state.position.tolist(), strict=True))
    return [
        (one.joint, position[one.leader], position[one.joint], wanted - position[one.joint])
        for one, wanted in zip(controller.joints, controller.wanted.tolist(), strict=True)
    ]
