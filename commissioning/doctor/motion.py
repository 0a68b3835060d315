"""Move each joint a little, for the checks that require motion. Torque is off before and after the motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from commissioning.commissioning_errors import text_with_notes
from commissioning.doctor.findings import Finding
from commissioning.doctor.measure import OpenPort
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, MotionTest
from commissioning.drive_trial import DriveTrial, TrialMotion
from commissioning.slow_arm import SlowArm
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import DriverError
from hal.compensation.gravity import Gravity
from hal.hal_errors import HalError
from hal.joint import Joint
from hal.servos.limp_arm import servo_name, torque_warning

Move = Callable[[ArmSnapshot, tuple[Finding, ...]], MotionTest]
"""Function that moves the joints, based on the measurements and findings so far."""

WAY_RAD: Final = 0.4
"""Angle by which each servo turns back and forth twice, in rad."""
FASTEST_RAD_S: Final = 1.0


def no_move(snapshot: ArmSnapshot, findings: tuple[Finding, ...]) -> MotionTest:
    """Do not move any joint, because the user did not request motion."""
    return MotionTest()


@dataclass(frozen=True, slots=True)
class SmallMotions:
    """A ``Move`` that moves all joints one after another, unless faults were found."""

    open_port: OpenPort
    clock: Clock
    gravity: Gravity | None = None
    stopped: Callable[[], int] = field(default=lambda: 0)
    """Function that returns the number of requests to stop (see ``SlowArm``)."""

    def __call__(self, snapshot: ArmSnapshot, findings: tuple[Finding, ...]) -> MotionTest:
        """Move the joints. A failure ends the test, but the motions before the failure are returned."""
        if reason := _reason_not_to_move(snapshot, findings):
            return MotionTest(not_moved=reason)
        all_joints = [servo.joint for bus in snapshot.buses for servo in bus.servos]
        motions: list[TrialMotion] = []
        for bus in snapshot.buses:
            arm = self._arm(bus)
            try:
                with arm:
                    for index in range(len(arm.joints)):
                        motions.append(self._joint(arm, index, all_joints))
            except (DriverError, HalError) as error:
                text = text_with_notes(error)
                if arm.torque_left or (arm.begun and not self.stopped()):
                    return MotionTest(tuple(motions), failed=text)
                return MotionTest(tuple(motions), not_moved=text)
        return MotionTest(tuple(motions))

    def _arm(self, bus: BusSnapshot) -> SlowArm:
        joints = [servo.joint for servo in bus.servos]
        models = {joint.servo_id: joint.model for joint in joints}

        def open_bus() -> Bus:
            return Bus(self.open_port(bus.port, bus.baud), self.clock, models)

        return SlowArm(open_bus, joints, self.clock, self.stopped, FASTEST_RAD_S)

    def _joint(self, arm: SlowArm, index: int, all_joints: Sequence[Joint]) -> TrialMotion:
        trial = DriveTrial(arm, index, _way(arm, index))
        trial.run()
        ends = (0.0, trial.way)
        return trial.motion(max((self._sag(arm, index, way, all_joints) for way in ends), key=abs))

    def _sag(self, arm: SlowArm, index: int, way: float, all_joints: Sequence[Joint]) -> float:
        """Return the sag of one joint after a motion by the signed distance ``way``. Joints on other buses are assumed
        to be at position 0."""
        joint = arm.joints[index]
        if self.gravity is None or joint.compliance is None:
            return 0.0
        at = {one.name: float(arm.state.position[i]) for i, one in enumerate(arm.joints)}
        at[joint.name] += way
        torques = self.gravity.torques(np.array([at.get(one.name, 0.0) for one in all_joints]))
        return float(torques[[one.name for one in all_joints].index(joint.name)]) / joint.compliance.stiffness


def _reason_not_to_move(snapshot: ArmSnapshot, findings: tuple[Finding, ...]) -> str:
    """Return the reason why the joints must not be moved, or an empty string."""
    servos = [servo for bus in snapshot.buses for servo in bus.servos]
    if held := [servo_name(servo.joint) for servo in servos if servo.registers.get("torque_enable")]:
        return (
            f"{torque_warning(held)}. The motion test would disable the torque at its end. Support the arm, disable "
            "its torque, and run the doctor again"
        )
    if any(finding.severity == "fault" for finding in findings):
        return "The joints were not moved, because there are faults. Fix the faults and run the doctor again"
    if unread := [servo_name(servo.joint) for servo in servos if "torque_enable" not in servo.registers]:
        return (
            f"The joints were not moved, because the torque state of {', '.join(unread)} could not be read. Run the "
            "doctor again"
        )
    return ""


def _way(arm: SlowArm, index: int) -> float:
    """Return the motion of the joint, from its current goal toward the middle of its range."""
    joint = arm.joints[index]
    start, limits = float(arm.command[index]), joint.limits
    longest = min(WAY_RAD * joint.transmission, 0.5 * (limits.upper - limits.lower))
    return longest if start < 0.5 * (limits.lower + limits.upper) else -longest
