"""Seen from another process, states are published and the last command is written again in every cycle."""

import math
import os
import re
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from statistics import median

import pytest
from control_msgs.msg import DynamicJointState
from sensor_msgs.msg import JointState

from servoloop.stack.shipped_files import HOME, URDF
from tests.ros.deaf import deaf_client
from tests.ros.stack_process import running
from tests.ros.topic_client import EVERY, TopicClient, place, topic_client
from tests.ros.two_components import ARM, FOLLOWER, HAND, JOINT, block

PERIOD_S = 0.05
IN_A_ROW = 20


def _install(folder: Path) -> None:
    """Create the files of an installed package that provides the hardware."""
    info = folder / "springs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: springs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[servoloop.hardware]\nfactory/Springs = tests.ros.spring_hardware:make\n")


def _urdf() -> str:
    """Run the arm on springs. The effort of the hand is the number of the cycle."""
    counted = JOINT.format(HAND).replace("</joint>", '  <state_interface name="effort"/>\n    </joint>')
    joints = "".join(map(JOINT.format, ARM)) + counted + FOLLOWER
    springs = block("springs", "<plugin>factory/Springs</plugin>", joints)
    return re.sub(r"<ros2_control.*</ros2_control>", springs, URDF.read_text(), flags=re.DOTALL)


@pytest.fixture(scope="module")
def client(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TopicClient]:
    folder = tmp_path_factory.mktemp("springs")
    _install(folder)
    urdf = folder / "springs.urdf"
    urdf.write_text(_urdf())
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{folder}{os.pathsep}{HOME}")
        with running(folder, "--urdf", str(urdf)), topic_client() as client:
            yield client


def cycle(message: JointState) -> int:
    """Return the number of the cycle in which a state was measured."""
    return int(message.effort[message.name.index(HAND)])


def stamp_s(message: JointState | DynamicJointState) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)


def in_a_row(states: list[JointState]) -> list[JointState]:
    """Return consecutive states. A slow machine may skip a cycle."""
    row = states[-IN_A_ROW:]
    return row if [cycle(state) - cycle(row[0]) for state in row] == list(range(IN_A_ROW)) else []


def test_every_cycle_is_published_even_if_the_ros_thread_was_blocked(client: TopicClient) -> None:
    with client.hearing(JointState, "/joint_states", EVERY) as states, deaf_client(client.node) as hold_up:
        client.spin_until(lambda: states)
        for number in range(1, 6):
            hold_up()
            client.spin_until(lambda number=number: cycle(states[-1]) > cycle(states[0]) + 10 * number)
    numbers = [cycle(state) for state in states]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    stamps_s = [stamp_s(state) for state in states]
    assert median(b - a for a, b in pairwise(stamps_s)) == pytest.approx(PERIOD_S, abs=0.002)
    assert stamps_s == sorted(set(stamps_s))


@pytest.mark.row("jsb-topics", "golden-joint-states")
def test_joint_states_are_published_at_every_update_with_wall_clock_stamps(client: TopicClient) -> None:
    begin_s = time.time()
    with client.hearing(JointState, "/joint_states", EVERY) as states:
        client.spin_until(lambda: bool(in_a_row(states)))
    row, end_s = in_a_row(states), time.time()
    stamps_s = [stamp_s(state) for state in row]
    assert begin_s - PERIOD_S < stamps_s[0] and stamps_s[-1] <= end_s
    between_s = [after - before for before, after in pairwise(stamps_s)]
    assert min(between_s) > 0.0
    assert median(between_s) == pytest.approx(PERIOD_S, rel=0.1)


@pytest.mark.row("jsb-topics")
def test_dynamic_joint_states_are_published_with_joint_states(client: TopicClient) -> None:
    with (
        client.hearing(JointState, "/joint_states", EVERY) as states,
        client.hearing(DynamicJointState, "/dynamic_joint_states", EVERY) as dynamic,
    ):
        client.spin_until(lambda: len(dynamic) >= IN_A_ROW and bool(in_a_row(states)))
    assert {message.header.frame_id for message in (*states, *dynamic)} == {"base_link"}
    measured = {stamp_s(state): cycle(state) for state in states}
    shown = {}
    for message in dynamic:
        (values,) = (v for v in message.interface_values if "effort" in v.interface_names)
        shown[stamp_s(message)] = int(values.values[values.interface_names.index("effort")])
    both = measured.keys() & shown.keys()
    assert len(both) >= IN_A_ROW - 1
    assert {at: measured[at] for at in both} == {at: shown[at] for at in both}


@pytest.mark.row("jsb-full")
def test_missing_interfaces_are_nan_and_fields_have_full_length(client: TopicClient) -> None:
    state = client.first(JointState, "/joint_states")
    assert len(state.position) == len(state.velocity) == len(state.effort) == len(state.name) == 8
    assert [name for name, effort in zip(state.name, state.effort, strict=True) if not math.isnan(effort)] == [HAND]


@pytest.mark.row("fwd-every-cycle")
def test_last_command_is_written_in_every_cycle(client: TopicClient) -> None:
    """A single command holds the joints against the springs in all cycles."""
    client.send("hand_controller", 0.02)
    client.arrives(hand_right_joint=0.02)
    with client.hearing(JointState, "/joint_states", EVERY) as states:
        client.spin_until(lambda: bool(in_a_row(states)))
    assert [place(state, HAND) for state in states] == pytest.approx([0.02] * len(states))
