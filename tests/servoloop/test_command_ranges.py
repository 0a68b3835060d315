"""``min`` and ``max`` of the command interfaces limit the commands of all controllers."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.forward.forward_command_controller import ForwardCommandController
from controller.forward.rate_command_controller import RateCommandController
from controller.gripper.goal import GripperGoal
from controller.gripper.gripper_action_controller import GripperActionController
from controller.interface import ControllerContext
from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.components.component_lifecycle import configure_all
from hal.hal_errors import DescriptionError
from hal.robot_description.description import parse_urdf
from hal.robot_description.limit_check import WHEEL_SPEED_RAD_S
from servoloop.stack.hardware import HardwareKind, build
from servoloop.stack.robot_files import Files, read_files
from servoloop.stack.shipped_files import URDF
from sim_backend.clock import SimulatedClock

PERIOD_S = 0.02
JOINT = (
    '<link name="base"/><link name="arm"/>'
    '<joint name="lift" type="{kind}"><parent link="base"/><child link="arm"/>'
    '<limit lower="-1" upper="1" velocity="2" effort="3"/></joint>'
)
BLOCK = """
<ros2_control name="arm" type="system">
  <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
  <joint name="lift">{commands}<state_interface name="position"/><state_interface name="velocity"/></joint>
</ros2_control>"""
CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 50
    enforce_command_limits: {enforced}
    lift_controller: {{type: {kind}}}
lift_controller:
  ros__parameters: {{{parameters}}}
"""
TRAJECTORY = (
    "joint_trajectory_controller/JointTrajectoryController",
    "joints: [lift], command_interfaces: [position], state_interfaces: [position, velocity]",
)


def interface(kind: str = "position", **ends: Any) -> str:
    params = "".join(f'<param name="{name}">{value}</param>' for name, value in ends.items())
    return f'<command_interface name="{kind}">{params}</command_interface>'


def urdf(*commands: str, kind: str = "revolute") -> str:
    return f'<robot name="r">{JOINT.format(kind=kind)}{BLOCK.format(commands="".join(commands))}</robot>'


class Stack:
    """Stack with one joint of a mock component and one controller."""

    def __init__(self, folder: Path, text: str, kind: str, parameters: str, enforced: str = "true") -> None:
        (folder / "arm.urdf").write_text(text)
        (folder / "controllers.yaml").write_text(
            CONTROLLERS.format(kind=kind, parameters=parameters, enforced=enforced)
        )
        self.files: Files = read_files(folder / "arm.urdf", folder / "controllers.yaml")
        clock, files = SimulatedClock(), self.files
        hardware = build(HardwareKind.MOCK, files, {}, clock).hardware
        manager = ControllerManager(hardware, files.limits)
        context = ControllerContext(files.description, files.component, files.limits, lambda name: True)
        self.controller: Any = Factory(files.controllers, context).make(files.controllers.controllers[0])
        manager.registry.add(self.controller)
        self.loop = ControlLoop(hardware, manager, files.limits, clock, PERIOD_S)
        configure_all(hardware)
        self.loop.activate()

    def sent(self, commands: Sequence[float], cycles: int = 100) -> float:
        """Return the command that reaches the joint while a client repeats ``commands``."""
        for _ in range(cycles):
            self.controller.submit(list(commands))
            self.loop.step()
        return float(self.loop.command[0])


def test_a_trajectory_beyond_the_range_is_refused_but_one_to_its_limit_arrives(tmp_path: Path) -> None:
    stack = Stack(tmp_path, urdf(interface(min=-0.5, max=0.5)), *TRAJECTORY)
    assert isinstance(stack.controller, JointTrajectoryController)
    stack.loop.step()
    reason = stack.controller.check(TrajectoryGoal(("lift",), (GoalPoint((0.9,), 1.0),)))
    assert reason is not None and "outside its limits -0.5000 to 0.5000" in reason
    goal = TrajectoryGoal(("lift",), (GoalPoint((0.5,), 1.0),))
    assert stack.controller.check(goal) is None
    stack.controller.submit(goal)
    for _ in range(100):
        stack.loop.clock.sleep_until(stack.loop.clock.now() + PERIOD_S)
        stack.loop.step()
    assert stack.loop.command[0] == pytest.approx(0.5)


@pytest.mark.parametrize("enforced", ["true", "false"])
def test_a_forwarded_position_is_limited_to_the_range(
    enforced: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    kind, parameters = ForwardCommandController.kind, "joints: [lift], interface_name: position"
    stack = Stack(tmp_path, urdf(interface(min=-0.25, max=0.5)), kind, parameters, enforced)
    assert ("enforce_command_limits: false has no effect" in caplog.text) is (enforced == "false")
    assert stack.sent([2.0]) == pytest.approx(0.5)
    assert stack.sent([-2.0]) == pytest.approx(-0.25)


def test_a_gripper_goal_beyond_the_range_is_refused(tmp_path: Path) -> None:
    stack = Stack(tmp_path, urdf(interface(max=0.5)), GripperActionController.kind, "joint: lift")
    reason = stack.controller.check(GripperGoal(0.9))
    assert reason == "position 0.9 is outside the limits -1 to 0.5 of lift"


@pytest.mark.parametrize(
    ("kind", "ends", "command", "reaches"),
    [
        ("velocity", {"min": -0.2, "max": 1.0}, 5.0, 1.0),
        ("velocity", {"min": -0.2, "max": 1.0}, -5.0, -0.2),
        ("velocity", {"min": 0.0, "max": 1.0}, -5.0, 0.0),
        ("velocity", {"min": -9.0, "max": 9.0}, 5.0, 2.0),
        ("effort", {"max": 0.5}, 5.0, 0.5),
        ("effort", {"max": 0.5}, -5.0, -3.0),
        ("effort", {"min": -0.1, "max": 0.5}, -5.0, -0.1),
    ],
)
def test_velocities_and_efforts_have_their_own_ranges(
    tmp_path: Path, kind: str, ends: dict[str, float], command: float, reaches: float
) -> None:
    text = urdf(interface(kind, **ends), kind="continuous")
    stack = Stack(tmp_path, text, ForwardCommandController.kind, f"joints: [lift], interface_name: {kind}")
    assert isinstance(stack.controller, RateCommandController)
    assert stack.sent([command]) == pytest.approx(reaches)
    stack.controller.command = np.array([command])  # the safety gate does not rely on the controller
    stack.loop.send(np.array([command]))
    assert stack.loop.command[0] == pytest.approx(reaches)


def test_a_velocity_range_also_limits_position_motions(tmp_path: Path) -> None:
    text = urdf(interface(), interface("velocity", min=-0.2, max=1.0))
    stack = Stack(tmp_path, text, *TRAJECTORY)
    assert stack.files.limits["lift"].velocity == 0.2
    stack.loop.send(np.array([1.0, 0.0]))
    assert stack.loop.command[0] == pytest.approx(0.2 * PERIOD_S)


def test_a_continuous_joint_with_a_range_is_limited(tmp_path: Path) -> None:
    stack = Stack(tmp_path, urdf(interface(min=-4, max=4), kind="continuous"), *TRAJECTORY)
    stack.loop.step()
    assert stack.controller.check(TrajectoryGoal(("lift",), (GoalPoint((5.0,), 9.0),))) is not None
    free = parse_urdf(urdf(interface(), kind="continuous")).joints["lift"]
    assert (free.lower, free.upper) == (-np.inf, np.inf)


def test_servos_stay_in_the_range_while_calibration_uses_the_whole_travel(tmp_path: Path) -> None:
    text = URDF.read_text()
    at = text.index('<command_interface name="position"/>')
    narrow = text[:at] + interface(max=0.5) + text[at + len('<command_interface name="position"/>') :]
    (tmp_path / "arm.urdf").write_text(narrow)
    joint, whole = read_files(tmp_path / "arm.urdf").robot.joints[0], read_files().robot.joints[0]
    assert joint.limits.upper == 0.5 and joint.position(joint.counts(2.0)) == pytest.approx(0.5, abs=2e-3)
    assert joint.between_stops().limits == whole.limits
    assert whole.between_stops() is whole


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (urdf(interface(min=0.5, max=-0.5)), "lift/position: min 0.5 is above max -0.5 (arm.urdf, line 4): swap them."),
        (
            urdf(interface(min=0.5, max=0.5)),
            "lift/position: min 0.5 equals max 0.5 (arm.urdf, line 4): widen the range.",
        ),
        (urdf(interface(min="low")), "lift/position: min must be a number, not 'low' (arm.urdf, line 4): write a"),
        (urdf(interface(max="nan")), "lift/position: max must be a number, not 'nan' (arm.urdf, line 4): write a"),
        (urdf(interface(max="")), "lift/position: max must be a number, not '' (arm.urdf, line 4): write a"),
        (
            urdf(interface(min=2, max=3)),
            "lift/position: min 2.0 and max 3.0 (arm.urdf, line 4) are outside the joint's limits -1.0 to 1.0: correct",
        ),
        (
            urdf(interface(min=1)),
            "lift/position: min 1.0 and max inf (arm.urdf, line 4) are outside the joint's limits",
        ),
        (
            urdf(interface("velocity", min=0.2)),
            "lift/velocity: min 0.2 and max inf (arm.urdf, line 4) exclude 0, so the joint could not be stopped",
        ),
        (
            urdf(interface("effort", min=-2, max=-1)),
            "lift/effort: min -2.0 and max -1.0 (arm.urdf, line 4) exclude 0, so the joint could not be stopped",
        ),
        (
            urdf(interface(), interface("velocity", min=0)),
            "lift/velocity: min 0.0 and max inf (arm.urdf, line 4) allow only one direction, but lift also takes",
        ),
        (
            urdf(interface(min=0), kind="continuous"),
            "lift/position: min 0.0 and max inf (arm.urdf, line 4) limit only one end, but a continuous joint needs",
        ),
        (
            urdf(interface().replace("</", '<param name="max">1</param><param name="max">2</param></')),
            "lift/position has max twice (arm.urdf, line 4): remove one.",
        ),
    ],
)
def test_an_invalid_range_is_reported_with_its_line(text: str, says: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        parse_urdf(text, "arm.urdf")
    assert says in str(caught.value)


def test_a_range_beyond_the_joint_limit_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = urdf(interface(min=-5, max=0.5))
    stack = Stack(tmp_path, text, *TRAJECTORY)
    assert (stack.files.limits["lift"].lower, stack.files.limits["lift"].upper) == (-1.0, 0.5)
    assert "lift/position: min -5.0 is below the joint's limit -1.0 (" in caplog.text


def test_a_wheel_without_a_limit_is_driven_within_a_default_speed(tmp_path: Path) -> None:
    text = urdf(interface("velocity"), kind="continuous")
    text = text.replace('<limit lower="-1" upper="1" velocity="2" effort="3"/>', "")
    assert "lift has no velocity limit" in parse_urdf(text).warnings[0]
    stack = Stack(tmp_path, text, ForwardCommandController.kind, "joints: [lift], interface_name: velocity")
    assert stack.sent([100.0]) == pytest.approx(WHEEL_SPEED_RAD_S)


def test_a_continuous_joint_with_positions_needs_a_limit() -> None:
    text = urdf(interface(), kind="continuous").replace('<limit lower="-1" upper="1" velocity="2" effort="3"/>', "")
    with pytest.raises(DescriptionError, match="velocity limit must be above 0"):
        parse_urdf(text)


def test_a_joint_without_commands_may_have_placeholder_limits() -> None:
    text = urdf(kind="revolute").replace('upper="1" velocity="2"', 'upper="100000" velocity="100000"')
    assert parse_urdf(text).joints["lift"].upper == 100000.0
