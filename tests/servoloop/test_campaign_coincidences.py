"""Faults that rarely coincide by chance are drawn together, and each of them is possible on its arm."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.servos import sts
from servoloop.campaign.campaign import files_of, read_scenario, run_schedule_of, schedule_of
from servoloop.campaign.draws.arm import NEWER_FIRMWARE
from servoloop.campaign.draws.coincidences import DrawnRun, draw_coincidence
from servoloop.simulation.acts import Move, Reactivate, SocketDeath
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule, after_the_end
from servoloop.simulation.stack_faults import inventory_of
from sim_backend.faults.player import require_possible

SCENARIO = read_scenario(Path(__file__).parents[2] / "docs" / "campaign.yaml")
ACTS = (Move(at_s=1.0, positions={}), Reactivate(at_s=2.0, for_s=0.0), Reactivate(at_s=5.0, for_s=0.5))
SEEDS = range(400)


def drawn(arm: str, acts: tuple[Move | Reactivate | SocketDeath, ...], end_s: float | None = 9.0) -> Counter[str]:
    """Return how often each combination of faults is drawn. Every combination must be possible on the arm."""
    files, found = files_of(arm), Counter[str]()
    run = DrawnRun(files.robot.joints, acts, end_s, 8.0)
    for seed in SEEDS:
        events, moved = draw_coincidence(seed, run)
        require_possible(events, inventory_of(files))
        assert len(events) <= 2
        assert [act.at_s for act in moved] == sorted(act.at_s for act in moved)
        schedule = Schedule.model_validate({"seconds": end_s or 0.0, "job": () if end_s else ("A",), "faults": events})
        assert after_the_end(schedule) == []
        found[", ".join(f"{event.kind} since {event.since}" for event in events)] += 1
    return found


@pytest.mark.parametrize("arm", ["robot_arm", "koch", "bimanual_so101"])
def test_coincidences_are_drawn_more_often_for_arms_with_several_buses(arm: str) -> None:
    found = drawn(arm, ACTS[:1])
    assert (0.3 < found[""] / len(SEEDS) < 0.6) if arm == "bimanual_so101" else (0.7 < found[""] / len(SEEDS) < 0.9)
    assert (found["adapter_unplugged since up"] > 0) == (arm == "bimanual_so101")
    assert {
        "weak_supply since up, hot since up",
        "adapter_unplugged since end, silent since end",
        "adapter_unplugged since up, brown_out since up",
        "adapter_unplugged since end, overload since end",
        "overload since end",
        "overload since up",
        "jammed since up",
    } <= found.keys()


def test_runs_with_activations_have_alarms_and_lost_replies() -> None:
    found = drawn("koch", ACTS)
    assert 0.3 < found[""] / len(SEEDS) < 0.5
    assert {
        "hardware_error since up, brown_out since up",
        "lost_replies since up",
        "brown_out since up, lost_replies since up",
    } <= found.keys()


def test_faults_of_a_run_with_jobs_around_its_end_are_relative_to_the_end() -> None:
    found = drawn("robot_arm", (), None)
    assert "adapter_unplugged since end, silent since end" in found
    assert "adapter_unplugged since up, silent since up" not in found and "jammed since up" not in found


def test_only_a_joint_near_the_seam_of_its_encoder_is_pushed_over_it() -> None:
    files = files_of("robot_arm")
    run = DrawnRun(files.robot.joints, ACTS[:1], 9.0, 8.0)
    each = [draw_coincidence(seed, run)[1] for seed in SEEDS]
    moves = [act for acts in each for act in acts if isinstance(act, Move) and act.positions]
    assert {joint for act in moves for joint in act.positions} == {"joint1", "joint6"}
    assert {position for act in moves for position in act.positions.values()} == {-3.05, 3.05}
    sockets = replace(run, acts=(SocketDeath(at_s=1.0),))
    assert all(draw_coincidence(seed, sockets)[1] == sockets.acts for seed in SEEDS)


def test_few_runs_have_the_arm_that_is_seldom_drawn_and_half_of_the_dynamixels_have_newer_firmware() -> None:
    schedules = [schedule_of(SCENARIO, seed) for seed in range(300)]
    arms = Counter(one.arm for one in schedules)
    assert 3 <= arms["bimanual_so101"] <= 25
    assert {one.firmware for one in schedules if one.arm != "koch"} == {None}
    newer = sum(one.firmware == NEWER_FIRMWARE for one in schedules)
    assert 0.35 * arms["koch"] < newer < 0.65 * arms["koch"]


def test_a_second_signal_skips_the_motion_to_the_park_pose_but_releases_the_arm() -> None:
    stacks: list[FaultyStack] = []
    schedule = Schedule(seconds=0.5, on_exit="relax", hurry_s=0.3)
    for one in (schedule, schedule.model_copy(update={"hurry_s": None})):
        assert run_schedule_of(one, stacks.append).violations == ()
    hurried, parked = stacks
    assert hurried.clock.now() < parked.clock.now()
    for stack in stacks:
        place = stack.player.targets.place
        assert not any(
            place(joint.servo_id, None).servo.memory.get(sts.torque_enable) for joint in stack.files.robot.joints
        )
