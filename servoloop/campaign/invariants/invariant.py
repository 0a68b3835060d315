"""The form of an invariant: what looks on at one simulated stack and says what must not be."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState
from servoloop.simulation.faulty_stack import FaultyStack

DECEIVING: Final = frozenset(
    {
        "slipped_horn",
        "stuck_encoder",
        "dead_encoder",
        "false_position",
        "false_value",
        "wrong_mode",
        "wrong_setting",
        "eeprom_gone",
        "collision",
    }
)
"""Faults with which a servo's position and its joint's are two things, for a time or from then on."""

COMPLAINTS: Final = ("status", "hardware_error_status")
"""Registers that are 0 as long as a servo has nothing to complain of."""


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
        self.examined = 0
        """How often the condition was really looked at: an invariant that examined nothing has shown nothing."""
        self.joints = stack.files.robot.joints
        self.commanded = [name.rpartition("/")[0] for name in stack.loop.hardware.command_interfaces]
        """The joint of each command interface."""
        place = stack.player.targets.place
        self.servos: dict[str, Any] = {joint.name: place(joint.servo_id, joint.bus).servo for joint in self.joints}
        """The virtual servo of each joint."""

    @property
    def active(self) -> bool:
        """Whether the hardware drives its joints, and no component is being switched."""
        hardware = self.stack.loop.hardware
        return hardware.state is LifecycleState.ACTIVE and not any(one.switching for one in hardware.components)

    def true_positions(self) -> dict[str, float]:
        """Where the joints of the simulated world are, rad or m, by name: no servo and no conversion is asked."""
        return dict(zip(self.stack.world.joints, self.stack.world.position().tolist(), strict=True))

    def deceived(self, joint: str) -> bool:
        """Whether the joint's servo has ever reported another position than its joint had."""
        return bool(DECEIVING & self.stack.touches.kinds(joint))

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

    def on_command(self, values: FloatArray) -> None:
        """Called with each command that leaves the safety gate, shape (m,), while the program ends too."""

    def on_step(self, time_s: float) -> None:
        """Called after each step of the physics, a millisecond."""

    def on_state(self, state: JointState) -> None:
        """Called at the end of each cycle with its measurement."""

    def at_end(self) -> None:
        """Called when the program has ended and the hardware is released."""


def complains(joint: Joint, servo: Any) -> bool:
    """Whether a virtual servo reports that it has protected itself."""
    return any(servo.memory.get(one) for one in series_of(joint.model).registers if one.name in COMPLAINTS)
