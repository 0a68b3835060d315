"""Tests of the LeRobot plugin's connection to a stack, with a virtual arm. These tests do not need LeRobot."""

import math
import socket
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import monotonic

import pytest

from lerobot_servoloop import connection
from lerobot_servoloop.arm import ArmChoice, ConnectedArm
from lerobot_servoloop.connection import StackError
from lerobot_servoloop.units import JointScale, joint_scales
from servoloop.command_socket.command_errors import KINDS
from servoloop.stack.robot_files import read_files
from tests.command_socket.rig import SocketRig, served
from tests.live.rig import runtime_folder
from tests.servoloop.served import eventually
from tests.stack.rig import ARM, READY

HAND = "hand_right_joint"
JOINTS = [*ARM, HAND]
LIMITS = {"lower": -1.0, "upper": 2.0}
ARM_REPLY = {
    "name": "arm",
    "joints": ["turn", "endless", "hand"],
    "limits": {"turn": LIMITS, "endless": {"lower": None, "upper": None}, "hand": {"lower": 0.0, "upper": 0.05}},
    "hand": "hand",
    "hand_open": 0.04,
    "hand_closed": 0.0,
}


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[SocketRig]:
    with served(monkeypatch) as rig:
        yield rig


@pytest.fixture
def connect(rig: SocketRig) -> Iterator[Callable[..., ConnectedArm]]:
    """Yield a function that connects to the arm, by default with all joints and in degrees."""
    arms: list[ConnectedArm] = []

    def connect(
        arm: str | None = None, joints: list[str] = JOINTS, use_degrees: bool = True, namespace: str | None = None
    ) -> ConnectedArm:
        arms.append(ConnectedArm(ArmChoice(arm, joints, use_degrees, namespace), "test"))
        return arms[-1]

    yield connect
    for arm in arms:
        arm.close()


def refused(kind: str, call: Callable[[], object]) -> str:
    """Return the message of the StackError that a call raises."""
    with pytest.raises(StackError) as raised:
        call()
    assert raised.value.kind == kind
    return str(raised.value)


def test_values_have_the_units_of_lerobot() -> None:
    degrees = joint_scales(ARM_REPLY, ["turn", "endless", "hand"], True)
    assert degrees["turn"].value(math.pi / 4) == pytest.approx(45.0)
    assert degrees["endless"].position(720.0) == pytest.approx(4 * math.pi)
    shares = joint_scales(ARM_REPLY, ["turn", "hand"], False)
    assert [shares["turn"].value(at) for at in (-1.0, 0.5, 2.0)] == pytest.approx([-100.0, 0.0, 100.0])
    for scales in (degrees, shares):
        assert [scales["hand"].value(at) for at in (0.0, 0.05)] == pytest.approx([0.0, 100.0])
    assert "endless" in refused("input", lambda: joint_scales(ARM_REPLY, ["endless"], False))


@pytest.mark.parametrize(
    ("opened", "closed", "values"), [(0.0, 0.04, [100.0, 0.0]), (0.04, 0.0, [0.0, 100.0]), (None, None, [0.0, 100.0])]
)
def test_a_gripper_has_zero_where_it_is_closed(opened: float | None, closed: float | None, values: list[float]) -> None:
    arm = {**ARM_REPLY, "hand_open": opened, "hand_closed": closed}
    scale = joint_scales(arm, ["hand"], True)["hand"]
    assert [scale.value(at) for at in (0.0, 0.05)] == pytest.approx(values)


@pytest.mark.parametrize(("value", "position"), [(20.0, 0.2), (-500.0, -1.0), (500.0, 2.0)])
def test_targets_are_clipped_to_the_limits(value: float, position: float) -> None:
    assert JointScale(0.0, 0.01, -1.0, 2.0).position(value) == pytest.approx(position)


def test_the_arm_follows_and_holds(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    arm = connect()
    arm.take(max_age_s=60.0)
    target = math.degrees(rig.positions()[5]) + 10.0
    sent = arm.send({"joint6": target, HAND: 50.0})
    assert sent == pytest.approx({"joint6": target, HAND: 50.0})
    eventually(lambda: arm.positions()["joint6"] == pytest.approx(target, abs=1.0))
    eventually(lambda: arm.positions()[HAND] == pytest.approx(50.0, abs=3.0))
    arm.close()
    held = connect()
    eventually(lambda: held.positions()["joint6"] == pytest.approx(target, abs=1.0))


def test_a_target_beyond_the_limits_is_sent_as_the_limit(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    arm = connect()
    arm.take(max_age_s=60.0)
    sent = arm.send({"joint6": 1e4})
    limits = rig.stack.files.limits["joint6"]
    assert sent["joint6"] == pytest.approx(math.degrees(limits.upper))


def test_a_stream_that_was_silent_is_opened_again(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    """LeRobot sends no actions while it saves an episode."""
    rig.pause_s = 0.02
    arm = connect()
    arm.take(max_age_s=1.0)
    before, taken_s = arm.positions()["joint6"], rig.stack.loop.clock.now()
    eventually(lambda: rig.stack.loop.clock.now() > taken_s + 2.0)
    assert arm.send({"joint6": before + 5.0})["joint6"] == pytest.approx(before + 5.0)


def test_a_leader_is_released_and_can_be_taken_by_another_client(connect: Callable[..., ConnectedArm]) -> None:
    leader = connect()
    leader.release_torque()
    assert leader.positions().keys() == set(JOINTS)
    follower = connect()
    follower.take(max_age_s=60.0)  # the torque is enabled again
    follower.send({HAND: 10.0})


def test_the_result_of_a_stopped_goal_is_not_a_reply(rig: SocketRig) -> None:
    program = connection.StackConnection(rig.running.commands, "test")
    program.request("take")
    points = [{"positions": [*READY[:5], READY[5] + 1.0], "time_s": 5.0}]
    program.request("goal", joints=ARM, points=points, sent_s=monotonic())
    with rig.client("other") as other:
        other.request("take", force=True)
        other.request("watch", rate_hz=1000.0)
        eventually(lambda: [event for event in other.events(0.1) if event["event"] == "state"])
    assert program.request("state")["ok"]
    program.close()


def test_no_stack_and_a_stack_of_another_name(monkeypatch: pytest.MonkeyPatch) -> None:
    with runtime_folder(monkeypatch) as folder:
        find = partial(ConnectedArm, ArmChoice(None, JOINTS, True), "test")
        assert "servoloop up" in refused("not_found", find)
        (folder / "servoloop").mkdir()
        left = socket.socket(socket.AF_UNIX)
        left.bind(str(folder / "servoloop" / "so101-1.command"))
        left.close()
        assert "servoloop up" in refused("not_found", find)


def test_the_arm_is_chosen_by_name_and_process(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    text = refused("not_found", lambda: connect("so101"))
    assert text.startswith("no stack of so101 is running. Running stacks: robot_arm (process")
    assert connect("robot_arm").label == connect(str(rig.running.pid)).label


def test_a_loop_of_links_is_the_folder_of_no_stack(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    with served(monkeypatch, replace(read_files(), folder=tmp_path)):
        text = refused("not_found", lambda: connection.find_stack_connection(str(loop), None, "test"))
    assert text.startswith(f"no stack of {loop} is running. Running stacks: robot_arm")


def test_two_stacks_need_a_choice(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    path: Path = rig.running.commands
    path.with_name("so101-1.command").symlink_to(path)
    text = refused("not_found", connect)
    assert text.startswith("several stacks are running: ") and "option `arm`" in text and "`namespace`" in text


def test_the_arm_is_chosen_by_namespace(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    path: Path = rig.running.commands
    path.with_name("lab.left@robot_arm-1.command").symlink_to(path)
    for namespace, label in (
        ("lab/left", "robot_arm in /lab/left (process 1)"),
        ("/lab/left", "robot_arm in /lab/left"),
    ):
        assert connect(namespace=namespace).label.startswith(label)
    assert (
        connect(namespace="").label == connect("robot_arm", namespace="/").label == rig.running.label.partition(",")[0]
    )
    assert refused("not_found", lambda: connect("robot_arm", namespace="right")).startswith(
        "no stack of robot_arm in the namespace /right is running. Running stacks: robot_arm in /lab/left (process 1), "
    )


def test_the_arm_is_chosen_by_a_long_namespace(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hash replaces the name of the arm and its namespace in the name of the socket."""
    files, namespace = read_files(), "/lab/" + "n" * 95
    with served(monkeypatch, replace(files, controllers=replace(files.controllers, namespace=namespace))) as rig:
        found = connection.find_stack_connection("robot_arm", namespace, "test")
        assert found.label == f"robot_arm in {namespace} (process {rig.running.pid})"
        found.close()


def test_another_version_of_the_protocol(monkeypatch: pytest.MonkeyPatch, connect: Callable[..., ConnectedArm]) -> None:
    monkeypatch.setattr(connection, "VERSION", 2)
    text = refused("version", connect)
    assert "version 1" in text and "Install the version of this plugin" in text


def test_another_owner_of_the_motion(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    with rig.client("page") as page:
        page.request("take")
        assert refused("owned", lambda: connect().take(1.0)).startswith("page ")


def test_a_stop_in_mid_motion_ends_the_targets(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    arm = connect()
    arm.take(max_age_s=60.0)
    arm.send({"joint6": 90.0})
    with rig.client("page") as page:
        page.request("stop")
    text = refused("not_owner", lambda: arm.send({"joint6": 91.0}))
    assert text.startswith("LeRobot no longer moves robot_arm, because page ") and "has stopped all motions" in text


def test_joints_and_values_that_are_invalid(rig: SocketRig, connect: Callable[..., ConnectedArm]) -> None:
    text = refused("unknown", lambda: connect(joints=["shoulder"]))
    assert text.startswith("robot_arm has no joint 'shoulder': its joints are joint1, ")
    arm = connect()
    arm.take(max_age_s=60.0)
    before = rig.positions()
    assert "'shoulder'" in refused("unknown", lambda: arm.send({"joint1": 0.0, "shoulder": 1.0}))
    assert "joint6 is nan" in refused("input", lambda: arm.send({"joint6": math.nan}))
    assert rig.positions() == pytest.approx(before, abs=1e-6)


def test_the_end_of_the_stack_in_mid_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    with served(monkeypatch) as rig:
        arm = ConnectedArm(ArmChoice(None, JOINTS, True), "test")
        arm.take(max_age_s=60.0)
        arm.send({"joint6": 90.0})
        assert rig.positions()
    for call in (arm.positions, lambda: arm.send({"joint6": 91.0})):
        assert refused("ended", call).endswith("has ended: start `servoloop up` again")


def test_a_stack_that_does_not_reply(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "TIMEOUT_S", 0.05)
    with runtime_folder(monkeypatch) as folder, socket.socket(socket.AF_UNIX) as silent:
        (folder / "servoloop").mkdir()
        silent.bind(str(folder / "servoloop" / "so101-1.command"))
        silent.listen()
        monkeypatch.setattr(connection.StackConnection.request, "__defaults__", (0.05,))
        text = refused("timeout", lambda: ConnectedArm(ArmChoice(None, JOINTS, True), "test"))
        assert text == "the stack of so101 (process 1) does not reply within 0.05 s: check its log"


def test_kinds_of_errors_are_those_of_the_protocol() -> None:
    assert {"ended", "timeout", "version", "not_owner", "stream_ended", "unknown", "input", "failed"} <= KINDS.keys()
