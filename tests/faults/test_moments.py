"""Faults during the whole life of a stack. Their times are relative to its start, to the moment when it is up, or to
its end."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from hal.lifecycle import LifecycleState
from pick_place.settings import JobSettings
from servoloop.campaign.run import RunReport, end_program, run_schedule, with_exit_policy
from servoloop.campaign.shrink import shrink
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.stack_faults import inventory_of
from servoloop.testing.arm import VirtualArm
from sim_backend.buses.feetech import VirtualBus
from sim_backend.faults.draw import draw
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.script import read_script
from sim_backend.faults.targets import FaultTargets
from sim_backend.faults.text import matching, parse, text_of
from sim_backend.mechanics.plant import BenchPlant
from tests.complaint import complaint
from tests.faults.rig import FaultRig, files_of
from tests.faults.strategies import TWO_LINES
from tests.pages import code


def life(*texts: str, seconds: float = 0.3) -> RunReport:
    faults = tuple(map(parse, texts))
    return run_schedule(files_of("robot_arm"), {"": JobSettings()}, Schedule(seconds=seconds, faults=faults))


def test_fault_times_count_from_when_the_arm_is_up_by_default(tmp_path: Path) -> None:
    assert parse("silent id=3").since == "up"
    event = parse("silent id=3 at=5ms since=end for=2s")
    assert event.since == "end" and text_of(event) == "silent id=3 at=0.005s since=end for=2.0s"
    path = tmp_path / "faults.yaml"
    path.write_text("- {kind: silent, servo_id: 3, since: start}\n- {kind: silent, servo_id: 3, since: noon}\n")
    with pytest.raises(FaultError, match=rf"{path}:2: 1.silent.since: must be 'start', 'up' or 'end'"):
        read_script(path)


@pytest.mark.runs("faults.md yaml 2")
def test_the_documented_faults_of_start_and_end_happen(tmp_path: Path) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(code("faults.md", "yaml", 2))
    at_the_start, at_the_end = read_script(path)
    assert "servo 3: responds only intermittently" in life(text_of(at_the_start)).ended
    assert life(text_of(at_the_end)).violations == ()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("adapter_unplugged since=start", "there is no virtual"),
        ("silent id=3 since=start", "servo 3: does not respond at any baud rate"),
        ("silent id=3 at=20ms since=start", "servo 3: responds only intermittently"),
    ],
)
def test_the_program_ends_if_the_arm_cannot_come_up(text: str, why: str) -> None:
    report = life(text)
    assert why in report.ended
    assert report.violations == () and report.simulated_s < 10.0


def test_a_disturbed_start_continues() -> None:
    report = life("missed_instructions id=3 chance=0.2 since=start for=30ms")
    assert report.ended == "" and report.violations == ()


@pytest.mark.parametrize("text", ["silent id=3 at=50ms since=end", "adapter_unplugged at=50ms since=end"])
def test_a_fault_happens_while_the_program_ends(text: str) -> None:
    stack = FaultyStack(files=files_of("robot_arm"), keep_alive=True)
    stack.player.plan([parse(text)])
    stack.up()
    stack.run(0.3)
    assert not stack.player.happened
    ends_s = stack.world.time_s
    end_program(stack)
    assert [event.kind for event in stack.player.happened] == [parse(text).kind]
    assert 0.05 < stack.world.time_s - ends_s < 1.5  # the relief waits up to 1 s for a silent joint


def test_faults_that_wait_for_their_moment_are_listed_and_can_be_canceled() -> None:
    rig = FaultRig()
    rig.player.plan(map(parse, ("silent id=3 since=end", "hot id=2 at=1s", "silent id=4 since=end")))
    rig.up()
    assert [event.kind for event in rig.player.coming] == ["hot", "silent", "silent"]
    rig.player.cancel(matching("silent id=3"))
    assert [text_of(event) for event in rig.player.coming] == ["hot id=2 at=1.0s", "silent id=4 since=end"]


def test_faults_of_a_past_moment_are_refused() -> None:
    rig = FaultRig()
    rig.up()
    with pytest.raises(FaultError, match=r"silent at 0 s since start: this time has already passed"):
        rig.play(parse("silent id=3 since=start"))
    rig.player.reach("end", rig.world.time_s)
    with pytest.raises(FaultError, match="since end: this time has already passed"):
        rig.play(parse("silent id=3 since=end"))


def test_servos_without_a_stack_have_no_start_or_end() -> None:
    player = FaultPlayer(FaultTargets({"": VirtualBus.of(BenchPlant((1, 2)))}))
    with pytest.raises(FaultError) as refused:
        player.play([parse("silent id=1 since=start"), parse("silent id=2 at=1s since=end"), parse("silent id=2")])
    assert str(refused.value).splitlines() == [
        "silent at 0 s since start: there is no stack here that starts: "
        "omit `since`, or play the fault with servoloop campaign",
        "silent at 1 s since end: there is no stack here that ends: "
        "omit `since`, or play the fault with servoloop campaign",
    ]


def test_a_simulation_without_an_end_refuses_faults_of_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    faults = tmp_path / "faults.yaml"
    faults.write_text("- {kind: echo, since: start}\n- {kind: echo, since: end}\n")
    said = complaint(capsys, monkeypatch, "simulate", "--seconds", "1", "--faults", str(faults))
    assert f"{faults}:2: echo at 0 s since end: there is no stack here that ends" in said and ":1:" not in said


def test_a_third_of_the_drawn_faults_starts_at_the_start_or_the_end() -> None:
    drawn = [event for seed in range(100) for event in draw(seed, TWO_LINES, 10.0, 20)]
    share = Counter(event.since for event in drawn)
    assert all(0.13 < share[since] / len(drawn) < 0.20 for since in ("start", "end"))
    assert all(event.at_s <= TWO_LINES.start_s for event in drawn if event.since == "start")
    assert all(event.at_s <= 0.2 for event in drawn if event.since == "end")
    assert max(event.at_s for event in drawn) > 9.0
    unended = replace(TWO_LINES, end_s=None)
    assert {event.since for seed in range(9) for event in draw(seed, unended, 10.0, 20)} == {"start", "up"}


@pytest.mark.parametrize("arm", ["robot_arm", "robot_arm_dynamixel", "so101", "koch"])
def test_faults_of_the_start_are_drawn_within_the_activation(arm: str) -> None:
    there = inventory_of(files_of(arm))
    rig = FaultRig(arm)
    rig.up()
    assert there.start_s == pytest.approx(rig.clock.now(), rel=0.1)


def test_parking_takes_longer_than_holding() -> None:
    files = files_of("robot_arm")
    parking = with_exit_policy(files, "relax")
    held_s, parking_s = inventory_of(files).end_s, inventory_of(parking).end_s
    assert held_s == 0.2 and parking_s is not None
    stack = FaultyStack(files=parking, keep_alive=True)
    stack.up()
    stack.run(0.3)
    begun_s = stack.clock.now()
    end_program(stack)
    assert stack.loop.hardware.state is not LifecycleState.ACTIVE
    assert held_s < stack.clock.now() - begun_s < parking_s + 1.0


def test_shrinking_tries_the_same_fault_while_the_arm_is_up() -> None:
    faults = tuple(map(parse, ("silent id=3 at=12ms since=end", "echo at=20ms since=start for=50ms")))
    (left,) = shrink(Schedule(faults=faults), lambda one: any(event.kind == "echo" for event in one.faults)).faults
    assert left.since == "up"


def test_user_tests_can_plan_faults_of_the_end() -> None:
    arm = VirtualArm({"arm": "robot_arm"})
    arm.plan("silent id=3 at=20ms since=end")
    arm.up()
    arm.run(0.2)
    assert arm.end() == ""
    assert [event.kind for event in arm.stack.player.happened] == ["silent"]


def test_user_tests_draw_no_faults_of_the_start() -> None:
    arm = VirtualArm({"arm": "robot_arm"})
    arm.draw(40)
    assert {event.since for event in arm._faults} == {"up", "end"}
