"""The form of an invariant: what looks on at one simulated stack and says what must not be."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.types import JointState
from servoloop.simulation.faulty_stack import FaultyStack


@dataclass(frozen=True, slots=True)
class Violation:
    """An invariant that fell, when (s of the stack's clock), and how."""

    invariant: str
    time_s: float
    text: str


class Invariant:
    """What looks on at one stack; a subclass overrides what it has a use for, and ``say``\\ s what must not be."""

    name = ""

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        self.stack = stack
        self.say = say
        self.joints = stack.files.robot.joints
        place = stack.player.targets.place
        self.servos: dict[str, Any] = {joint.name: place(joint.servo_id, joint.bus).servo for joint in self.joints}
        """The virtual servo of each joint."""

    @property
    def active(self) -> bool:
        """Whether the hardware drives its joints."""
        return self.stack.loop.hardware.state is LifecycleState.ACTIVE

    @property
    def shared_id(self) -> bool:
        """Whether two servos answer to one ID: one of them was given another's, or its EEPROM forgot its own."""
        if any(one.kind == "collision" for one in self.stack.player.active.values()):
            return True
        return any(len({one.servo_id for one in line.servos}) < len(line.servos) for line in self.stack.lines.values())

    def torque(self, joint: Joint) -> bool:
        """Whether the joint's servo drives its motor, as it is and not as the stack knows it."""
        return bool(self.servos[joint.name].memory.get(series_of(joint.model).torque_enable) != 0)

    def on_write(self, bus: str, data: bytes) -> None:
        """Called with every packet, before the servos of this line hear it."""

    def on_step(self, time_s: float) -> None:
        """Called after each step of the physics, a millisecond."""

    def on_state(self, state: JointState) -> None:
        """Called at the end of each cycle with its measurement."""

    def at_end(self) -> None:
        """Called when the program has ended and the hardware is released."""
