"""A leader arm as a hardware component: its servos are limp and only read, a hand moves it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from drivers.bus.bus import Bus
from drivers.clock import Clock
from hal.errors import ActivationError
from hal.joint import Joint
from hal.servos.limp_arm import LimpArm, falls
from hal.types import JointState

LEADER: Final = "leader"


def leader_joint(joint: str) -> str:
    """The name of a leader's joint among those of both arms."""
    return f"{LEADER}/{joint}"


class LeaderArm(LimpArm):
    """A leader takes no commands, and stays inactive: nothing here can switch its torque on.

    Its joints are called ``leader/NAME``, for a follower may have some of the same names.
    """

    def __init__(
        self, joints: Sequence[Joint], open_buses: Callable[[], Bus | Mapping[str, Bus]], clock: Clock
    ) -> None:
        super().__init__(LEADER, [replace(one, name=leader_joint(one.name)) for one in joints], open_buses, clock)
        self.command_interfaces = ()
        self.asked_s = self.measured_s = 0.0
        """When it was asked, and when it was asked for what was measured last, on the clock."""
        self._let_go = False

    def configure(self) -> None:
        """Find all servos. Torque stays as it is.

        Raises ActivationError if a leader that was limp comes back with torque: it may be another arm.
        """
        super().configure()
        if self._let_go and (servos := self.held()):
            self.cleanup()
            raise ActivationError(f"the leader was limp before it was lost. Now {falls(servos)}: restart teleoperation")

    def let_go(self) -> None:
        super().let_go()
        self._let_go = True

    def activate(self) -> None:
        """Raises ActivationError: a leader is never driven."""
        raise ActivationError("a leader is moved by hand: it gets no torque")

    def request(self, deadline_s: float | None = None) -> None:
        self.asked_s = self._clock.now()
        super().request(deadline_s)

    def read(self) -> JointState:
        state = super().read()
        self.measured_s = self.asked_s  # its angles are no older
        return state
