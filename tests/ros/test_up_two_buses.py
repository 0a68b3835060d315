"""One component with Feetech and Dynamixel servos on two serial buses, in real processes."""

from collections.abc import Mapping
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState

from servoloop.stack.shipped_files import CONFIG, CONTROLLERS
from tests.ros.stack_process import JOINTS, READY, StackProcess
from tests.ros.trajectory_client import REACHED, SUCCEEDED, TrajectoryClient, goal_of, point, trajectory
from tests.ros.trajectory_stacks import client_of

pytestmark = pytest.mark.slow

ROBOT = ("--robot", str(CONFIG / "robot_arm_two_buses.yaml"))
HAND = "hand_right_joint"
HALF_CLOSED_M = 0.015  # The cube is closer to the arm here.
SERVOS = {f"{joint} (servo arm/{i})" for i, joint in enumerate(JOINTS, start=1)} | {f"{HAND} (servo hand/1)"}
HARDWARE_IDS = {f"robot_arm/arm/{i}" for i in range(1, 7)} | {"robot_arm/hand/1"}
ERROR_RAD = 0.08  # Servos sag when the arm leans.
ERROR_M = 0.002


def _controllers(folder: Path) -> Path:
    """The controller of the arm also moves the hand, so it does not have to wait for another controller."""
    text = CONTROLLERS.read_text()
    arm = "joints: [joint1, joint2, joint3, joint4, joint5, joint6]"
    assert text.count(arm) == 1
    path = folder / "controllers.yaml"
    path.write_text(text.replace(arm, f"joints: [{', '.join((*JOINTS, HAND))}]\n    wait_for: []"))
    return path


def _servos(report: DiagnosticArray) -> dict[str, DiagnosticStatus]:
    """Return the status of each servo in a report."""
    statuses = {status.name.removeprefix("servoloop: "): status for status in report.status}
    return {name: status for name, status in statuses.items() if "(servo " in name}


def _replies(status: DiagnosticStatus) -> int:
    (count,) = (value.value for value in status.values if value.key == "replies")
    return int(count)


def _moves_both_lines(client: TrajectoryClient) -> None:
    states: list[JointState] = []
    client.node.create_subscription(JointState, "/joint_states", states.append, 10)
    way = trajectory(point([*READY, HALF_CLOSED_M], 2.0), names=[*JOINTS, HAND])
    assert client.outcome(client.send(goal_of(way))) == (SUCCEEDED, 0, REACHED), client.stack.words
    wanted = {**dict(zip(JOINTS, READY, strict=True)), HAND: HALF_CLOSED_M}

    def there() -> bool:
        measured = dict(zip(states[-1].name, states[-1].position, strict=True))
        errors = {joint: abs(measured[joint] - place) for joint, place in wanted.items()}
        return all(error < (ERROR_M if joint == HAND else ERROR_RAD) for joint, error in errors.items())

    client.until(there)


def _every_servo_goes_on_answering(first: Mapping[str, DiagnosticStatus], last: Mapping[str, DiagnosticStatus]) -> None:
    assert set(first) == set(last) == SERVOS
    assert {status.hardware_id for status in last.values()} == HARDWARE_IDS
    assert {status.message for status in last.values()} == {"ok"}
    assert [name for name in SERVOS if _replies(last[name]) <= _replies(first[name])] == []


def test_goal_over_two_buses_is_executed_and_every_servo_named(ros_domain: int, tmp_path: Path) -> None:
    link = tmp_path / "bus"
    ports = [word for name in ("arm", "hand") for word in ("--port", f"{name}={link}.{name}")]
    emulator = StackProcess(tmp_path / "emulate.log", "emulate", str(link), *ROBOT)
    try:
        for name in ("arm", "hand"):
            emulator.wait_for(tmp_path / f"bus.{name}")
        with client_of(tmp_path, *ROBOT, *ports, "--controllers", str(_controllers(tmp_path))) as client:
            reports: list[dict[str, DiagnosticStatus]] = []
            client.node.create_subscription(DiagnosticArray, "/diagnostics", lambda m: reports.append(_servos(m)), 10)
            client.until(lambda: bool(reports and reports[-1]))
            first = reports[-1]
            _moves_both_lines(client)
            client.until(lambda: reports[-1] is not first)
            _every_servo_goes_on_answering(first, reports[-1])
            assert client.stack.end() == 0, client.stack.words
    finally:
        emulator.end()
