"""Base class of invariants: conditions that are checked while a simulated stack runs."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.servos.catalog import series_of
from drivers.servos.register import Register
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.reference import read_reference
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal
from sim_backend.faults.event import Event
from sim_backend.faults.false_replies import FalsePosition, FalseValue
from sim_backend.faults.settings import WrongSetting

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
"""Faults after which the position that a servo reports temporarily or permanently differs from its joint's position, or
after which the servo moves differently. Of ``false_value`` and ``wrong_setting``, only some registers have this
effect."""
MOVING_SETTINGS: Final = frozenset(
    {
        *("homing_offset", "multi_turn_offset", "resolution_divider", "angular_resolution", "drive_mode", "phase"),
        *("control_mode", "min_position", "max_position", "min_position_limit", "max_position_limit"),
        *("cw_angle_limit", "ccw_angle_limit", "cw_dead_zone", "ccw_dead_zone", "minimum_startup_force"),
        *("position_p", "position_i", "position_d", "velocity_p", "velocity_i", "integral_limit", "hts", "dts"),
        *("max_torque", "pwm_limit", "pwm_slope", "current_limit", "velocity_limit", "max_velocity", "velocity_unit"),
        *("acceleration_limit", "max_acceleration", "acceleration_multiplier"),
    }
)
"""Settings that change the position that a servo reports, or how it moves."""
PRESENT_POSITION: Final = "present_position"
"""Name of the register that contains the position of a servo."""
UNREAD: Final = frozenset({"silent", "corrupt", "late", "no_time"})
"""Kinds of faults that prevent the stack from reading the state of a servo."""
COMPLAINTS: Final = ("status", "hardware_error_status")
"""Registers that are 0 unless the servo reports an error."""


@dataclass(frozen=True, slots=True)
class Violation:
    """Violation of an invariant in a run."""

    invariant: str
    """Name of the invariant."""
    time_s: float
    """Time of the violation on the stack's clock, in seconds."""
    text: str
    """Description of the violation."""


class Invariant:
    """Condition that must hold in a run of a simulated stack.

    A subclass sets ``name`` and overrides the methods for the events that it needs. It counts each check in
    ``examined`` and calls ``say`` with a description of each violation.

    Args:
        stack: The stack, before it is started.
        say: Function that reports a violation. Only the first violation of an invariant is kept.
        arm: Trajectory controller of the arm.
    """

    name = ""
    """Name of the invariant, as printed and as used in scenarios."""
    promised = True
    """Whether a campaign without ``promises`` fails if the condition of this invariant was never checked."""
    of_each_arm = False
    """Whether each arm of the robot has its own invariant of this class. If False, there is only one for the whole
    robot."""

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        self.stack = stack
        self.arm = arm
        self.say = say
        self.examined = 0
        """Number of times the condition was checked. Zero means that the run proves nothing about this invariant."""
        self.joints = stack.files.robot.joints
        self.driven_joints = [joint for one in stack.arms for joint in one.joints]
        """Joints of the trajectory controllers of all arms."""
        self.commanded = [name.rpartition("/")[0] for name in stack.loop.hardware.command_interfaces]
        """The joint that each command interface belongs to."""
        self._files = read_reference(stack.files)
        place = stack.player.targets.place
        self.servos: dict[str, Any] = {joint.name: place(joint.servo_id, joint.bus).servo for joint in self.joints}
        """The virtual servo of each joint."""
        self._torque_enable = {joint.name: series_of(joint.model).torque_enable for joint in self.joints}

    @cached_property
    def _error_registers(self) -> dict[str, list[Register]]:
        """The error registers of each joint's servo."""
        tables = {joint.name: series_of(joint.model).registers for joint in self.joints}
        return {name: [one for one in table if one.name in COMPLAINTS] for name, table in tables.items()}

    @property
    def active(self) -> bool:
        """Whether the hardware is active and none of its components is changing its state."""
        active = False
        for component in self.stack.loop.hardware.components:
            if component.switching:
                return False
            active = active or component.hardware.state is LifecycleState.ACTIVE
        return active

    @property
    def upset(self) -> bool:
        """Whether a fault changes the commands of a controller now."""
        return any(controller.upsets for controller in self.stack.controllers.values())

    @property
    def open_goals(self) -> list[LoggedGoal]:
        """Unfinished goals, except for those of the other arms of the robot."""
        others = {one.name for one in self.stack.arms} - {self.arm.name}
        return [logged for logged in self.stack.goals.open if logged.controller not in others]

    @property
    def newest_goal(self) -> LoggedGoal | None:
        """The latest goal that the arm's controller has accepted, finished or not."""
        return next((one for one in reversed(self.stack.goals.goals) if one.controller == self.arm.name), None)

    def true_positions(self) -> dict[str, float]:
        """Return the joint positions of the simulated world, in rad or m, keyed by joint name.

        They do not come from servos.
        """
        return dict(zip(self.stack.world.joints, self.stack.world.position().tolist(), strict=True))

    def reported_positions(self, state: JointState) -> dict[str, float]:
        """Return the positions that the stack reports in a cycle, in rad or m, keyed by joint name."""
        return dict(zip(self.stack.loop.hardware.joints, state.position.tolist(), strict=True))

    def off_command(self, joint: str, position: float) -> float:
        """Return the distance of a joint from its command, in rad or m.

        A joint that is blocked outside its limits counts as at the limit, because its command cannot follow further.
        """
        place = self.commanded.index(joint)
        command, limit = float(self.stack.loop.command[place]), self.stack.loop.limits[place]
        return min(abs(command - min(max(one, limit.lower), limit.upper)) for one in self.readings(joint, position))

    def readings(self, joint: str, position: float) -> list[float]:
        """Return the positions that the servo of a joint may report when the joint is at a true position."""
        known = self._files.get(joint)
        return [position] if known is None else known.readings(position, 0.0)

    def end_of_goal(self, joint: str, position: float) -> float:
        """Return the joint position at which a goal ends.

        A joint outside its limits may be sent its own position as a goal. Such a goal ends at the limit.
        """
        lower, upper = self.stack.narrowed.get(joint, (-math.inf, math.inf))
        return min(max(position, lower), upper)

    def deceived(self, joint: str) -> bool:
        """Return whether the joint's servo may report a wrong position, or move differently, because of a fault."""
        return any(_deceives(one) for one in self.stack.touches.events(joint))

    def never_confirmed(self, joint: str, leap_counts: float) -> bool:
        """Return whether two readings of a joint can never agree on a false position.

        This is the case if no two consecutive readings are false and all false readings are further from the true
        position than ``leap_counts``.
        """
        turn = next(one.model.counts_per_turn for one in self.joints if one.name == joint)
        return all(
            isinstance(one, FalsePosition)
            and (one.every > 1 or one.replies == 1)
            and abs(math.remainder(one.counts, turn)) > leap_counts
            for one in self.stack.touches.events(joint)
            if _deceives(one)
        )

    @property
    def sharing_id(self) -> frozenset[str]:
        """Return the joints whose servos share an ID, because of a collision or lost EEPROM contents."""
        active = self.stack.player.active.values()
        names = {name for one in active if one.kind == "collision" for name in self._of_collision(one)}
        for bus, line in self.stack.lines.items():
            ids = [one.servo_id for one in line.servos]
            if len(set(ids)) < len(ids):
                twice = {one for one in ids if ids.count(one) > 1}
                on_bus = (joint for joint in self.joints if joint.bus == bus)
                names.update(j.name for j in on_bus if {j.servo_id, self.servos[j.name].servo_id} & twice)
        return frozenset(names)

    def _of_collision(self, event: Event) -> set[str]:
        """Return the joints of the servo whose replies are disturbed, and of the servo that disturbs them."""
        ids = {getattr(event, "servo_id", None), getattr(event, "other_id", None)}
        bus = getattr(event, "bus", None)
        return {joint.name for joint in self.joints if joint.servo_id in ids and bus in (None, joint.bus)}

    def torque(self, joint: Joint) -> bool:
        """Return whether the torque of the joint's virtual servo is enabled. The stack may report a different state."""
        return bool(self.servos[joint.name].memory.get(self._torque_enable[joint.name]) != 0)

    def error_bits(self, joint: Joint) -> list[tuple[str, int]]:
        """Return the name and the value of each error register of the joint's virtual servo."""
        memory = self.servos[joint.name].memory
        return [(one.name, memory.get(one)) for one in self._error_registers[joint.name]]

    def reports_error(self, joint: Joint) -> bool:
        """Return whether the joint's virtual servo reports an error, such as overload protection."""
        return any(bits for _, bits in self.error_bits(joint))

    def released(self, state: JointState) -> set[str]:
        """Return the reported joints whose torque is off. Only an activation enables their torque.

        If a servo cannot be read, the stack cannot know that the servo has released its torque, and the next goal may
        enable the torque again.
        """
        if not state.faults or not self.active:
            return set()
        known = {name for name, fault in state.faults.items() if fault.kind not in UNREAD}
        return {joint.name for joint in self.joints if joint.name in known and not self.torque(joint)}

    def on_write(self, bus: str, data: bytes) -> None:
        """Called with every packet before the servos on this bus receive it."""

    def on_goals(self, bus: str, goals: Mapping[int, int]) -> None:
        """Called with the goals in a packet, in counts, keyed by servo ID, before the servos on this bus receive it."""

    def on_command(self, values: FloatArray) -> None:
        """Called with each command after the safety gate, as an array of shape (m,), even while the program ends."""

    def on_step(self, time_s: float) -> None:
        """Called after each physics step of one millisecond."""

    def on_motion(self, positions: FloatArray) -> None:
        """Called at the end of each cycle, before ``on_state``.

        Args:
            positions: Positions (m, n) of the joints of the simulated world after each physics step since the previous
                cycle.
        """

    def on_state(self, state: JointState) -> None:
        """Called at the end of each cycle with the measured state."""

    def at_end(self) -> None:
        """Called after the program has ended and the hardware has been released."""


def _deceives(event: Event) -> bool:
    """Return whether a fault changes the position that a servo reports, or how it moves."""
    if isinstance(event, FalseValue):
        return event.register_name == PRESENT_POSITION
    if isinstance(event, WrongSetting):
        return event.register_name in MOVING_SETTINGS
    return event.kind in DECEIVING
