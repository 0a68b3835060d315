"""The main job from the controllers to the cube, on simulated time."""

import numpy as np
import pytest

from controller.goal import GoalStatus
from servoloop.following import reference_at
from tests.stack.rig import BINS, PICK, READY, StackRig, Trace, UnpacedJob

LARGEST_RAD, RMS_RAD = 0.08, 0.03


@pytest.mark.parametrize("grade", BINS)
def test_a_client_that_never_pauses_for_the_hand_gets_its_cube_into_the_bin(grade: str) -> None:
    rig = StackRig().up()
    job = UnpacedJob(rig, grade)
    job.run()
    rig.run(1.0)
    assert [handle.status for handle in job.handles] == [GoalStatus.SUCCEEDED] * 4
    assert rig.world.cube_bin() == grade
    assert rig.loop.figures.missed == 0
    error = rig.trace.following_error()
    assert error.largest_rad < LARGEST_RAD
    assert error.rms_moving_rad < RMS_RAD


def test_job_after_job_without_a_restart() -> None:
    rig = StackRig().up()
    ended: list[str | None] = []
    for grade in "CAB":
        UnpacedJob(rig, grade).run()
        rig.run(1.5)
        ended.append(rig.world.cube_bin())
    assert ended == ["C", "A", "B"]


def test_no_arm_goal_takes_longer_than_its_client_waits() -> None:
    """The node gives a goal ten seconds; MoveIt gives its duration and a little."""
    rig = StackRig().up()
    job = UnpacedJob(rig, "A")
    sent_s: list[float] = []
    took_s: list[float] = []

    def react() -> None:
        job.react()
        while len(sent_s) < len(job.handles):
            sent_s.append(rig.clock.now())
        while len(took_s) < sum(handle.done for handle in job.handles):
            took_s.append(rig.clock.now() - sent_s[len(took_s)])

    rig.after_cycle = react
    rig.run(20.0, lambda: len(took_s) == 4)
    assert len(took_s) == 4
    assert max(took_s) < 1.1 * 2.0 + 1.5


def test_the_servos_interpolation_makes_the_motion_smoother() -> None:
    """Sag under gravity is the same in both; joint 6 turns about its own axis and shows the rest."""
    with_it, without = (_roll_errors(interpolate) for interpolate in (True, False))
    assert with_it["largest"] < 0.5 * without["largest"]
    assert with_it["rms"] < 0.5 * without["rms"]


def test_the_following_error_is_larger_without_interpolation_for_the_arm_as_a_whole() -> None:
    with_it, without = (_there_and_back(interpolate).following_error() for interpolate in (True, False))
    assert with_it.largest_rad < without.largest_rad
    assert with_it.rms_moving_rad < without.rms_moving_rad


def test_the_same_run_gives_the_same_bytes() -> None:
    def run() -> tuple[object, ...]:
        rig = StackRig().up()
        rig.bus.faults.corrupt_next(3)
        UnpacedJob(rig, "B").run(4.0)
        rig.bus.faults.silence(5)
        rig.run(0.5)
        return rig.port.sent, rig.port.received, rig.world.position().tolist(), rig.loop.figures

    assert run() == run()


def _there_and_back(interpolate: bool) -> Trace:
    rig = StackRig(interpolate=interpolate).up()
    for pose in (PICK, READY):
        rig.go(pose)
        rig.run(2.4)
    return rig.trace


def _roll_errors(interpolate: bool) -> dict[str, float]:
    trace = _there_and_back(interpolate)
    times, cycles = np.array(trace.world_s), np.array(trace.cycle_s)
    inside = (times >= cycles[0]) & (times <= cycles[-1])
    reference, speed = reference_at(times[inside], cycles, np.array(trace.position), np.array(trace.velocity))
    error = (reference - np.array(trace.actual)[inside])[:, 5][np.abs(speed[:, 5]) > 0.01]
    return {"largest": float(np.abs(error).max()), "rms": float(np.sqrt((error**2).mean()))}
