"""Every ending of ``servoloop up`` leaves the servos in a defined state, as read with the manufacturer's SDK."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from control_msgs.action import FollowJointTrajectory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.task import Future
from scservo_sdk import COMM_SUCCESS, PacketHandler, PortHandler

from drivers.servos import sts
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG, CONTROLLERS
from tests.ros.stack_process import JOINTS, PICK, READY, ArmClient, StackProcess, arm_client, emulating, running, until

pytestmark = pytest.mark.slow

IDS = range(1, 8)
ZERO_COUNTS = 2048
ABORTED = 6  # action_msgs/msg/GoalStatus


def read_all(link: Path, address: int, size: int) -> list[int]:
    """Read one register of every servo with another program. The port must be free."""
    port, packets = PortHandler(str(link)), PacketHandler(0)
    assert port.openPort() and port.setBaudRate(1_000_000)
    try:
        values = []
        for servo_id in IDS:
            for _ in range(20):  # The SDK times out after 34 ms, which a busy machine may exceed.
                data, result, _ = packets.readTxRx(port, servo_id, address, size)
                if result == COMM_SUCCESS:
                    break
            assert result == COMM_SUCCESS
            values.append(int.from_bytes(bytes(data), "little"))
        return values
    finally:
        port.closePort()


def torque(link: Path) -> list[int]:
    return read_all(link, sts.torque_enable.address, 1)


def start_moving(client: ArmClient) -> Future:
    """Start a motion from ready to pick, and return the future of the goal's result."""
    result = client.send(PICK)
    moving = client.node.create_subscription(
        FollowJointTrajectory.Impl.FeedbackMessage,
        "/arm_controller/follow_joint_trajectory/_action/feedback",
        lambda message: speeds.append(max(map(abs, message.feedback.actual.velocities))),
        10,
    )
    speeds: list[float] = []
    client.spin_until(lambda: bool(speeds) and speeds[-1] > 0.5)
    client.node.destroy_subscription(moving)
    return result


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_during_a_motion_stops_and_holds_the_arm(ros_domain: int, tmp_path: Path, number: int) -> None:
    with emulating(tmp_path) as link:
        with running(tmp_path, "--port", str(link)) as stack, arm_client() as client:
            result = start_moving(client)
            stack.process.send_signal(number)
            answer = client.wait(result)
            assert answer.status == ABORTED
            assert answer.result.error_string == "Current goal cancelled during deactivate transition."
            assert stack.process.wait(60.0) == 0, stack.words
        assert stack.words.splitlines()[-1].endswith("holds its position with torque enabled (on_exit: hold)")
        assert torque(link) == [1] * 7
        goals = read_all(link, sts.goal_position.address, 2)
        until(lambda: not any(read_all(link, sts.moving.address, 1)))
        position = read_all(link, sts.present_position.address, 2)
        assert all(abs(g - p) < 60 for g, p in zip(goals, position, strict=True))  # It only sags slightly.
        assert goals[5] not in (joint6_counts(READY[5]), joint6_counts(PICK[5]))  # It stopped before the goal.


def joint6_counts(position_rad: float) -> int:
    return round(position_rad * 4096 / 6.283185307179586) + ZERO_COUNTS


def test_on_exit_relax_parks_and_then_releases_torque(ros_domain: int, tmp_path: Path) -> None:
    robot = tmp_path / "relaxing.yaml"
    robot.write_text((CONFIG / "robot_arm.yaml").read_text().replace("virtual: hold", "virtual: relax"))
    with emulating(tmp_path) as link:
        with running(tmp_path, "--port", str(link), "--robot", str(robot)) as stack:
            assert stack.end(signal.SIGTERM) == 0, stack.words
        assert stack.words.splitlines()[-1].endswith("is in its park pose, and its torque is off")
        assert torque(link) == [0] * 7
        arm = read_all(link, sts.present_position.address, 2)[:6]
        parked = read_files(robot=robot).robot
        park = parked.file.park
        assert park is not None
        goals = [joint.counts(park.pose[joint.name]) for joint in parked.joints if joint.name in park.pose]
        # Without torque, the fingers sink by 1 cm onto the table.
        assert all(abs(counts - goal) < 80 for counts, goal in zip(arm, goals, strict=True)), arm


def test_lost_port_ends_the_stack_with_a_failure_and_a_reason(ros_domain: int, tmp_path: Path) -> None:
    with emulating(tmp_path) as link, running(tmp_path, "--port", str(link)) as stack:
        subprocess.run(["pkill", "-KILL", "-f", f"servoloop emulate {link}"], check=True)
        until(lambda: stack.process.poll() is not None)
        assert stack.process.returncode == 1
        assert "has disappeared" in stack.words
        assert "Traceback" not in stack.words


@contextmanager
def silencing_emulator(link: Path) -> Iterator["subprocess.Popen[bytes]"]:
    program = Path(__file__).with_name("silencing_emulator.py")
    process = subprocess.Popen([sys.executable, str(program), str(link)])
    try:
        until(link.exists)
        yield process
    finally:
        process.terminate()
        process.wait()


def test_silent_servo_is_named_and_the_others_are_read(ros_domain: int, tmp_path: Path) -> None:
    link = tmp_path / "bus"
    with silencing_emulator(link) as emulator, running(tmp_path, "--port", str(link)) as stack, arm_client() as client:
        levels: dict[str, str] = {}
        counts: dict[str, dict[str, str]] = {}

        def note(message: DiagnosticArray) -> None:
            levels.update({s.name: s.message for s in message.status})
            counts.update({s.name: {v.key: v.value for v in s.values} for s in message.status})

        client.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
        result = client.send(PICK)
        emulator.send_signal(signal.SIGUSR1)
        answer = client.wait(result)
        assert answer.status == ABORTED
        assert answer.result.error_string == "joint4: servo 4 does not respond"
        # At first, the servo is still read in every cycle.
        four = "servoloop: joint4 (servo 4)"
        client.spin_until(lambda: four in counts and counts[four]["skipped"] != "0")
        assert "servo 4 does not respond" in levels[four]
        others = [levels[f"servoloop: {name} (servo {i})"] for i, name in enumerate(JOINTS, 1) if i != 4]
        assert others == ["ok"] * 5
        silent, sound = (counts[f"servoloop: joint{i} (servo {i})"] for i in (4, 3))
        assert int(silent["silent"]) >= 3
        assert int(sound["replies"]) > int(silent["replies"]) > 0 == int(sound["corrupt"])
        assert set(counts[f"servoloop: {link}"]) == {"noise", "strange"}
        assert "joint4: servo 4 does not respond" in stack.words


def test_too_fast_rate_is_refused_before_torque_is_enabled(ros_domain: int, tmp_path: Path) -> None:
    controllers = tmp_path / "fast.yaml"
    controllers.write_text(CONTROLLERS.read_text().replace("update_rate: 20", "update_rate: 600"))
    with emulating(tmp_path) as link:
        stack = StackProcess(tmp_path / "up.log", "up", "--port", str(link), "--controllers", str(controllers))
        assert stack.process.wait(60.0) == 1
        assert f"servoloop: {controllers}: 600 Hz is too fast for {link}." in stack.words
        assert "set update_rate to 564 or less" in stack.words
        assert torque(link) == [0] * 7
