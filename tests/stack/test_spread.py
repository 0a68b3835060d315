"""The main job on arms with other friction, motors, masses and supply than the nominal, with backlash and without."""

from math import radians

import pytest

from controller.action_goals import GoalStatus
from tests.stack.rig import BINS, StackRig, UnpacedJob

LARGEST_RAD, RMS_RAD, AT_REST_RAD = 0.06, 0.02, 0.010
ACTIVATED_S = 2.5
"""Until then the arm has sunk with the torque, and has been lifted again."""
FEW, MANY = 5, 50
SEEDS = [*range(FEW), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(FEW, MANY))]
UPRIGHT = 0
"""Joint 1, whose axis gravity does not turn: nothing holds its link at one end of the gap, so it may hunt."""


@pytest.mark.parametrize("backlash_rad", [0.0, radians(1.0)], ids=["stiff", "backlash"])
@pytest.mark.parametrize("seed", SEEDS)
def test_any_arm_gets_its_cube_into_the_bin(seed: int, backlash_rad: float) -> None:
    grade = list(BINS)[seed % len(BINS)]
    rig = StackRig(seed=seed, backlash_rad=backlash_rad).up()
    rig.run(ACTIVATED_S)
    job = UnpacedJob(rig, grade)
    job.run()
    lay = {rig.world.cube_bin()}  # until it is taken away
    rig.after_cycle = lambda: lay.add(rig.world.cube_bin())
    rig.run(1.5)
    assert [handle.status for handle in job.handles] == [GoalStatus.SUCCEEDED] * 4
    assert lay - {None} == {grade}
    error = rig.trace.following(since_s=ACTIVATED_S)
    print(f"seed {seed}: {error.as_dict()}")
    assert max(error.largest_rad) <= LARGEST_RAD
    assert max(error.rms_moving_rad) <= RMS_RAD
    for joint, at_rest_rad in enumerate(error.at_rest_rad):
        assert at_rest_rad <= AT_REST_RAD + (0.5 * backlash_rad if joint == UPRIGHT else 0.0)
