"""What must hold at the end: of goals, and of the arm when the program has ended."""

from collections.abc import Callable
from typing import Final

import numpy as np

from controller.trajectory.goal import GoalHandle
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.types import JointState
from servoloop.campaign.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.faults.event import Event

COMPLAINTS: Final = ("status", "hardware_error_status")
"""Registers that are 0 as long as a servo has nothing to complain of."""


class GoalsEnd(Invariant):
    """Every goal that was taken has an end."""

    name = "every goal ends"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._goals: list[GoalHandle] = []

    def on_state(self, state: JointState) -> None:
        newest = self.stack.controllers[self.stack.arm.name].newest
        if newest is not None and (not self._goals or self._goals[-1] is not newest):
            self._goals.append(newest)

    def at_end(self) -> None:
        open_ones = [str(number) for number, goal in enumerate(self._goals, 1) if not goal.done]
        if open_ones:
            self.say(f"of {len(self._goals)} goals these have no end: {', '.join(open_ones)}")


class EndsAsChosen(Invariant):
    """At the end the arm is held, or parked and let go, as its robot file says, as far as its servos are reached.

    A servo that holds may still let go by itself, to protect itself, and complains. What happens to one behind the last
    cycle, while the program ends, nobody could have seen.
    """

    name = "ends as chosen"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._driven: set[str] = set()
        """Joints that were driven in the last cycle, and nothing wrong with them."""
        self._happened = 0
        """So many faults had begun or ended by then."""

    def on_state(self, state: JointState) -> None:
        self._happened = len(self.stack.player.happened)
        sound = {joint.name for joint in self.joints if joint.name not in state.faults and self.torque(joint)}
        self._driven = sound if self.active else set()

    def at_end(self) -> None:
        if self.stack.player.active:
            return
        on = {joint.name for joint in self.joints if self.torque(joint)}
        self._driven -= self._hit_at_the_end()
        if self.stack.files.robot.file.on_exit.virtual != "relax":
            self._tell(
                "let go", {joint.name for joint in self.joints if not self._complains(joint)} & self._driven - on
            )
            return
        self._tell("under torque", on)
        if len(self._driven) == len(self.joints):
            self._tell("not parked", self._not_parked())

    def _hit_at_the_end(self) -> set[str]:
        """The joints to which something has happened behind the last cycle."""
        events = self.stack.player.happened[self._happened :]
        return {joint.name for joint in self.joints if any(_hits(event, joint) for event in events)}

    def _complains(self, joint: Joint) -> bool:
        memory = self.servos[joint.name].memory
        return any(memory.get(one) for one in series_of(joint.model).registers if one.name in COMPLAINTS)

    def _not_parked(self) -> set[str]:
        park = self.stack.files.robot.file.park
        loop = self.stack.loop
        names = [name.rpartition("/")[0] for name in loop.hardware.command_interfaces]
        commands = dict(zip(names, loop.command, strict=True))
        pose = park.pose if park else {}
        return {name for name, position in pose.items() if not np.isclose(commands[name], position, atol=1e-6)}

    def _tell(self, what: str, joints: set[str]) -> None:
        if joints:
            self.say(f"{what}: {', '.join(sorted(joints))}")


def _hits(event: Event, joint: Joint) -> bool:
    """Whether a fault is one of the joint's servo, or of all."""
    servo_id, bus = getattr(event, "servo_id", None), getattr(event, "bus", None)
    return servo_id in (None, joint.servo_id) and bus in (None, joint.bus)
