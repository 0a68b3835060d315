"""The main job on arms with other friction, motors, masses and supply than the nominal, with backlash and without."""

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import load_pick_place
from sim_backend.buses.build import Build
from tests.drivers.fault_lines import CYCLES
from tests.stack.rig import BINS, UnpacedJob

LARGEST_RAD, RMS_RAD, AT_REST_RAD = 0.06, 0.02, 0.012
RESTING_RAD = 0.01
"""Of joint1, which no weight holds against its gear's teeth. The others sag by a cube's weight at first."""
ACTIVATED_S = 2.5
"""Until then the arm has sunk with the torque, and has been lifted again."""
FEW, SOME = 2, 5
SEEDS = [
    *range(FEW),
    *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(FEW, SOME)),
    *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(SOME, CYCLES // 200)),
]
"""Five, two of them in make test, and in make soak fifty."""


@pytest.mark.parametrize("backlash_deg", [0.0, 1.0], ids=["stiff", "backlash"])
@pytest.mark.parametrize("seed", SEEDS)
def test_any_arm_gets_its_cube_into_the_bin(seed: int, backlash_deg: float) -> None:
    grade = list(BINS)[seed % len(BINS)]
    rig = SimulatedStack(build=Build(backlash_deg, seed)).up()
    rig.run(ACTIVATED_S)
    job = UnpacedJob(rig, grade)
    job.run()
    lay = {rig.world.cube_bin()}  # until it is taken away
    rig.after_cycle = lambda: lay.add(rig.world.cube_bin())
    rig.run(1.5)
    assert [handle.status for handle in job.handles] == [GoalStatus.SUCCEEDED] * 4
    assert lay - {None} == {grade}
    error = rig.trace.following(since_s=ACTIVATED_S)
    print(f"seed {seed}: {error.as_dict(rig.arm.joints)}")
    assert max(error.largest_rad) <= LARGEST_RAD
    assert max(error.rms_moving_rad) <= RMS_RAD
    assert max(error.at_rest_rad) <= AT_REST_RAD


@pytest.mark.parametrize(("seed", "jobs"), [(9, 5), (13, 3)])
@pytest.mark.slow
def test_at_rest_between_jobs_no_joint_swings_through_its_backlash(seed: int, jobs: int) -> None:
    """A job's first goal is for where the arm is already: it ends no rest, nor what calms it."""
    rig = SimulatedStack(build=Build(1.0, seed)).up()
    rig.run(ACTIVATED_S)
    for number in range(jobs):
        begun_s = rig.clock.now()
        rig.run(0.33)
        UnpacedJob(rig, list(BINS)[number % len(BINS)]).run()
        error = rig.trace.following(since_s=begun_s)
        assert error.at_rest_rad[0] <= RESTING_RAD, number
        assert max(error.at_rest_rad) <= AT_REST_RAD, number


@pytest.mark.parametrize("seed", [None, 2])
def test_a_light_arm_is_not_driven_to_and_fro_by_what_calms_a_heavy_one(seed: int | None) -> None:
    """An SO-101's shoulder swings five times a second through its backlash: by itself it comes to rest."""
    arm = find_arm("so101")
    rig = SimulatedStack(files=read_arm_files(arm), build=Build(1.0, seed)).up()
    rig.run(ACTIVATED_S)
    UnpacedJob(rig, "A", load_pick_place(arm.pick_place).settings()).run()
    rig.run(12.0)
    last = np.array(rig.trace.actual)[-500:, 0]
    assert float(last.max() - last.min()) < 0.002
