"""Following error of soft servos with and without lead and gravity compensation."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.servos import sts, x
from hal.compensation.gravity import Gravity
from hal.compensation.joint_offset import JointOffset
from hal.joint import Joint
from hal.robot_description.description import Description
from hal.servos.gravity_compensation import GravityCompensation
from hal.types import FloatArray
from servoloop.recording.following_error import FollowingError
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.hardware import compensation
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
from tests.stack.rig import PICK, UnpacedJob

ROBOTS = ("robot_arm.yaml", "robot_arm_dynamixel.yaml")
LARGEST_RAD, RMS_RAD, AT_REST_RAD = 0.06, 0.02, 0.010
COUNT_RAD = 2.0 * np.pi / 4096
ACTIVATED_S = 2.5
"""Time for the arm to sink after the activation and to rise again, in seconds."""
WITHOUT_LEAD = ("  arm_controller:\n", "  arm_controller:\n    command_lead: 0.0\n")
WITHOUT_COMPENSATION = ("\non_exit:\n", "\ngravity_compensation: false\non_exit:\n")


class KnownOnly(JointOffset):
    """Offset of a joint without the slow correction."""

    def _correct(self, *_: object) -> None:
        pass


UNKNOWN_LOAD = ('<mass value="0.11"/>', '<mass value="0.03"/>')
"""Additional mass of the hand that is not contained in its URDF (80 g)."""


def known_only(joints: Sequence[Joint], description: Description) -> GravityCompensation:
    made = GravityCompensation(joints, Gravity(description, [joint.name for joint in joints]))
    made._each = [KnownOnly(joint) for joint in joints]
    return made


def loaded(joints: Sequence[Joint], description: Description) -> GravityCompensation | None:
    return compensation(joints, replace(description, xml=description.xml.replace(*UNKNOWN_LOAD)))


def loaded_known_only(joints: Sequence[Joint], description: Description) -> GravityCompensation:
    return known_only(joints, replace(description, xml=description.xml.replace(*UNKNOWN_LOAD)))


def following(robot: Path, changes: Sequence[tuple[str, str]] = (), make: object = compensation) -> FollowingError:
    """Return the following error of one job with a modified robot file."""
    text = robot.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    robot.write_text(text)
    rig = SimulatedStack(files=read_files(robot=robot), compensation=make).up()  # type: ignore[arg-type]
    rig.run(ACTIVATED_S)
    UnpacedJob(rig, "A").run()
    rig.run(1.5)
    return rig.trace.following(since_s=ACTIVATED_S)


@pytest.fixture
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a copy of a robot file, by default of the robot file of the STS arm."""
    path = tmp_path / getattr(request, "param", ROBOTS[0])
    path.write_text((CONFIG / path.name).read_text())
    return path


each_robot = pytest.mark.parametrize("robot", ROBOTS, indirect=True)


@each_robot
def test_soft_servos_follow_within_tolerance(robot: Path) -> None:
    error = following(robot)
    assert max(error.largest_rad) <= LARGEST_RAD
    assert max(error.rms_moving_rad) <= RMS_RAD
    assert max(error.at_rest_rad) <= AT_REST_RAD


def test_without_lead_compensation_the_arm_lags(robot: Path) -> None:
    without = following(robot, [WITHOUT_LEAD])
    assert max(without.rms_moving_rad) > 1.3 * max(following(robot, [WITHOUT_LEAD[::-1]]).rms_moving_rad)


def test_without_gravity_compensation_the_arm_sags(robot: Path) -> None:
    without = following(robot, [WITHOUT_COMPENSATION])
    assert max(without.at_rest_rad) > 2.0 * max(following(robot, [WITHOUT_COMPENSATION[::-1]]).at_rest_rad)


def test_slow_correction_compensates_unmodeled_masses(robot: Path) -> None:
    corrected, known = (following(robot, make=make).at_rest_rad for make in (loaded, loaded_known_only))
    carrying = slice(1, 4)  # joints 2 to 4
    assert max(corrected[carrying]) < 0.8 * max(known[carrying])


def test_compensation_fades_in_after_activation() -> None:
    rig = SimulatedStack().up()
    goals = [[servo.memory.get(sts.goal_position) for servo in rig.bus.servos]]
    for _ in range(40):
        rig.run(rig.loop.period_s)
        goals.append([servo.memory.get(sts.goal_position) for servo in rig.bus.servos])
    steps = np.abs(np.diff(goals, axis=0))
    assert steps[0].max() <= 1  # the arm sank between its two measurements
    assert steps.max() <= 4
    assert np.abs(np.subtract(goals[-1], goals[0])).max() > 20


@each_robot
@pytest.mark.slow
def test_arm_at_rest_stays_at_rest(robot: Path) -> None:
    """Friction and slow correction can make a joint drift around its goal. Elastic friction alone causes one count."""
    rig = SimulatedStack(files=read_files(robot=robot)).up()
    rig.go(PICK)
    rig.run(6.0)
    goal = sts.goal_position if robot.name == "robot_arm.yaml" else x.goal_position
    goals = [servo.memory.get(goal) for servo in rig.bus.servos]
    seen: list[FloatArray] = []
    rig.after_cycle = lambda: seen.append(rig.world.position()[:6].copy())
    rig.run(20.0)
    assert np.ptp(seen, axis=0).max() < 1.1 * COUNT_RAD
    assert np.abs(np.subtract([servo.memory.get(goal) for servo in rig.bus.servos], goals)).max() <= 1
