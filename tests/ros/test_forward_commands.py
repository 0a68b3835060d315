"""Forward command controllers, as seen from another process: valid and invalid commands."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from servoloop.stack.shipped_files import URDF
from tests.ros.stack_process import StackProcess, running, until
from tests.ros.topic_client import EVERY, TopicClient, place, topic_client

HAND = "hand_right_joint"
CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    hand_controller: {type: position_controllers/JointGroupPositionController}
    pair_controller: {type: forward_command_controller/ForwardCommandController}
    strict_controller: {type: position_controllers/JointGroupPositionController}
    speed_controller: {type: velocity_controllers/JointGroupVelocityController}
    lasting_controller: {type: velocity_controllers/JointGroupVelocityController}
hand_controller: {ros__parameters: {joints: [hand_right_joint]}}
pair_controller: {ros__parameters: {joints: [joint3, joint2], interface_name: position}}
strict_controller: {ros__parameters: {joints: [joint1], deactivate_on_wrong_length: true}}
speed_controller: {ros__parameters: {joints: [joint5]}}
lasting_controller: {ros__parameters: {joints: [joint6], command_timeout: 0.0}}
"""
NOT_FINITE = "Non-finite value received. Dropping message"


def _urdf() -> str:
    """The arm with mocks that compute dynamics. The last two joints are velocity-controlled."""
    text, found, blocks = URDF.read_text().partition("<ros2_control")
    ours = '<plugin>servoloop/ServoHardware</plugin>\n      <param name="robot">robot_arm.yaml</param>'
    mock = '<plugin>mock_components/GenericSystem</plugin><param name="calculate_dynamics">true</param>'
    assert ours in blocks
    blocks = blocks.replace(ours, mock)
    for joint in ("joint5", "joint6"):
        position = f'<joint name="{joint}">\n      <command_interface name="position"/>'
        assert position in blocks
        blocks = blocks.replace(position, position.replace("position", "velocity"))
    return text + found + blocks


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    folder = tmp_path_factory.mktemp("forward")
    files: dict[str, Path] = {}
    for option, name, text in (("--controllers", "controllers.yaml", CONTROLLERS), ("--urdf", "arm.urdf", _urdf())):
        files[option] = folder / name
        files[option].write_text(text)
    with running(folder, *(word for option, path in files.items() for word in (option, str(path)))) as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[TopicClient]:
    with topic_client() as client:
        yield client


@pytest.mark.row("fwd-finite", "golden-hand-dropped")
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_non_finite_value_drops_the_message(client: TopicClient, stack: StackProcess, value: float) -> None:
    """The message is dropped even if its other values are valid."""
    client.send("pair_controller", 0.1, -0.2)
    client.send("hand_controller", 0.02)
    client.arrives(joint3=0.1, joint2=-0.2, hand_right_joint=0.02)
    told = stack.words.count(NOT_FINITE)
    client.send("pair_controller", 0.3, value)
    client.send("hand_controller", value)
    until(lambda: stack.words.count(NOT_FINITE) == told + 2)
    client.stays(joint3=0.1, joint2=-0.2, hand_right_joint=0.02)
    client.send("pair_controller", 0.2, -0.1)
    client.send("hand_controller", 0.01)
    client.arrives(joint3=0.2, joint2=-0.1, hand_right_joint=0.01)


@pytest.mark.row("fwd-empty", "golden-hand-dropped")
def test_empty_command_is_ignored(client: TopicClient, stack: StackProcess) -> None:
    client.send("hand_controller", 0.03)
    client.arrives(hand_right_joint=0.03)
    told = stack.words
    client.send("hand_controller")
    client.send("hand_controller", math.nan)  # This message follows the empty message, and is logged.
    until(lambda: NOT_FINITE in stack.words.removeprefix(told))
    client.stays(hand_right_joint=0.03)
    assert "command size (0)" not in stack.words
    assert client.states()["hand_controller"] == "active"


@pytest.mark.row("fwd-length", "golden-hand-length")
@pytest.mark.parametrize(
    ("controller", "sound", "wrong"),
    [("hand_controller", [0.02], [0.01, 0.03]), ("pair_controller", [0.1, -0.2], [0.3])],
)
def test_command_of_wrong_length_is_ignored(
    client: TopicClient, stack: StackProcess, controller: str, sound: list[float], wrong: list[float]
) -> None:
    """In contrast, ros2_control deactivates the controller."""
    joints = ["joint3", "joint2"] if controller == "pair_controller" else [HAND]
    client.send(controller, *sound)
    client.arrives(**dict(zip(joints, sound, strict=True)))
    client.send(controller, *wrong)
    words = f"command size ({len(wrong)}) does not match number of interfaces ({len(sound)}): the command is dropped."
    until(lambda: words in stack.words)
    client.stays(**dict(zip(joints, sound, strict=True)))
    assert client.states()[controller] == "active"
    other = [value / 2 for value in sound]
    client.send(controller, *other)
    client.arrives(**dict(zip(joints, other, strict=True)))


@pytest.mark.row("fwd-length", "golden-hand-length")
def test_command_of_wrong_length_deactivates_the_controller_if_configured(
    client: TopicClient, stack: StackProcess
) -> None:
    """As in ros2_control, the joint holds its position and the other controllers continue. Commands sent while the
    controller is inactive have no effect after it is activated again."""
    client.send("strict_controller", 0.1)
    client.arrives(joint1=0.1)
    client.send("strict_controller", 0.2, 0.3)
    client.spin_until(lambda: client.states()["strict_controller"] == "inactive")
    assert "command size (2) does not match number of interfaces (1)" in stack.words
    assert [name for name, state in client.states().items() if state != "active"] == ["strict_controller"]
    client.send("strict_controller", 0.4)
    client.stays(joint1=0.1)
    assert client.switch(["strict_controller"])[0]
    client.stays(joint1=0.1)
    client.send("strict_controller", 0.3)
    client.arrives(joint1=0.3)


@pytest.mark.row("golden-hand-limits")
@pytest.mark.parametrize(("wanted", "limit"), [(0.5, 0.05), (-0.01, 0.0)])
def test_hand_command_is_limited(client: TopicClient, stack: StackProcess, wanted: float, limit: float) -> None:
    """In contrast, ros2_control passes the value on."""
    client.send("hand_controller", 0.025)
    client.arrives(hand_right_joint=0.025)
    with client.hearing(JointState, "/joint_states", EVERY) as states:
        client.send("hand_controller", wanted)
        client.arrives(hand_right_joint=limit)
        client.stays(hand_right_joint=limit)
    assert all(-1e-6 <= place(state, HAND) <= 0.05 + 1e-6 for state in states)
    assert f"hand_controller: [{wanted}] is outside the limits" in stack.words


@pytest.mark.row("fwd-every-cycle")
def test_speed_falls_to_zero_without_new_commands_by_default(client: TopicClient, stack: StackProcess) -> None:
    """In contrast, ros2_control keeps the speed even if the client has stopped."""

    def speed(state: JointState, joint: str) -> float:
        return float(state.velocity[state.name.index(joint)])

    with client.hearing(JointState, "/joint_states", EVERY) as seen:
        client.spin_until(lambda: bool(seen))
        client.send("lasting_controller", 0.05)
        client.send("speed_controller", 0.05)
        client.spin_until(lambda: max(speed(state, "joint5") for state in seen) > 0.0 == speed(seen[-1], "joint5"))
    assert max(speed(state, "joint5") for state in seen) == pytest.approx(0.05)
    assert "speed_controller: no command for " in stack.words
    states = client.some(JointState, "/joint_states", 10)
    assert [speed(state, "joint6") for state in states] == pytest.approx([0.05] * len(states))
    assert place(states[-1], "joint6") > place(states[0], "joint6")
    assert place(states[-1], "joint5") == place(states[0], "joint5") > 0.0
    client.send("lasting_controller", 0.0)
    client.first(JointState, "/joint_states", lambda m: speed(m, "joint6") == 0.0)
