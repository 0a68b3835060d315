"""Tables and plots of the page for a simulated arm."""

from dataclasses import replace

import numpy as np
import pytest

from hal.robot_description.description import parse_urdf
from servoloop.dashboard.page import controller_table, counter_table, faults, loop_table, servo_table
from servoloop.dashboard.tables import STRIPS, axis_range, strip_data
from servoloop.recording.robot_state import ObservedRobot
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.targets import FaultTargets
from sim_backend.faults.text import parse
from tests.recorder.rig import Rig
from tests.view.rig import moved_rig, watched

COLUMNS = {strip.columns[0]: strip.columns for strip in STRIPS}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return moved_rig()


@pytest.fixture(scope="module")
def seen(rig: Rig) -> ObservedRobot:
    return watched(rig)


def test_the_joint_table_uses_degrees_and_millimeters(seen: ObservedRobot) -> None:
    snapshot = seen.state.snapshot
    text = servo_table(snapshot, parse_urdf(snapshot.description_xml).joints)
    place = snapshot.joints.index("joint1")
    assert f"<td>{np.degrees(snapshot.position[place]):.1f}\u00a0°</td>" in text
    assert f"<td>{1e3 * snapshot.position[6]:.1f}\u00a0mm</td>" in text
    assert "27\u00a0°C" in text and "12.0\u00a0V" in text
    assert faults(snapshot) == ""


def test_loop_counters_and_controllers_have_tables(seen: ObservedRobot) -> None:
    snapshot = seen.state.snapshot
    assert "<td>missed cycles</td><td>0</td>" in loop_table(snapshot)
    assert "<td>rate hz</td><td>20</td>" in loop_table(snapshot)
    assert "<td>joint1 (servo 1)</td><td>none</td>" in counter_table(snapshot)
    table = controller_table(snapshot)
    assert "<td>robot_arm</td><td>active</td>" in table and "joint1" not in table and "control loop" not in table
    assert "<td>arm_controller: latest goal</td><td>succeeded" in table


def test_a_silent_servo_is_named_and_counted() -> None:
    rig = Rig()
    player = FaultPlayer(FaultTargets(rig.stack.lines, rig.stack.world))
    rig.run(0.2)
    player.play([parse("silent id=3")])
    player.update(rig.stack.clock.now())
    rig.run(1.5)
    snapshot = watched(rig).state.snapshot
    assert "joint3 (servo 3)" in faults(snapshot) and "does not respond" in faults(snapshot)
    row = next(row for row in counter_table(snapshot).split("<tr") if "joint3" in row)
    assert "silent " in row
    assert ">joint3: servo 3 does not respond</b>" in servo_table(snapshot, {})


def test_messages_of_a_stack_are_escaped(seen: ObservedRobot) -> None:
    snapshot = seen.state.snapshot
    name = "servoloop: joint1 (servo 1)"
    evil = replace(snapshot.statuses[name], level=2, message="<script>1</script>", values={"<b>": "<i>"})
    shown = replace(snapshot, statuses={name: evil, "<u>": evil})
    for text in (faults(shown), servo_table(shown, {}), counter_table(shown), controller_table(shown)):
        assert "<script>" not in text and "<i>" not in text and "<u>" not in text


def test_a_plot_covers_the_last_minute(rig: Rig, seen: ObservedRobot) -> None:
    times, position, command = strip_data(seen.minute(), COLUMNS["position"], 0)
    assert times[-1] == 0.0 and times[0] == pytest.approx(rig.samples[0].state.stamp_s - rig.samples[-1].state.stamp_s)
    assert position[-1] == rig.samples[-1].state.position[0] and command[-1] == pytest.approx(0.2)
    times, voltage = strip_data(seen.minute(), COLUMNS["voltage_v"], 0)
    assert len(times) == len(voltage) >= 4 and (voltage > 11.0).all() and times[0] < times[-1] <= 0.0


def test_an_empty_plot_can_be_drawn() -> None:
    assert [len(data) for data in strip_data(ObservedRobot().minute(), ("position", "command"), 0)] == [1, 1, 1]


def test_an_axis_contains_all_values_and_does_not_follow_noise() -> None:
    low, high = axis_range([np.array([0.1, 0.9, np.nan]), np.array([-0.2])], 0.02)
    assert low < -0.2 and high > 0.9 and high - low <= 2.0
    quiet = [axis_range([np.full(9, 12.0 + noise)], 2.0) for noise in (0.0, 0.04, 0.08)]
    assert len(set(quiet)) == 1 and axis_range([np.array([np.nan])], 0.5)[0] < 0.0
