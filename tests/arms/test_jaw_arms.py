"""Arms with a jaw, in simulated time: the scene alone, and the pick-and-place job through the whole stack."""

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from pick_place.settings import JobSettings
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import PickPlace, load_pick_place
from sim_backend.buses.build import Build
from sim_backend.scene.world import World
from tests.drivers.fault_lines import CYCLES
from tests.stack.rig import UnpacedJob

SCENES = ["so101", "so100", "koch"]
ARMS = [*SCENES, "so101_12v"]
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
GRADES = ["A", "B", "C"]
ACTIVATED_S = 2.5
LARGEST_RAD, RMS_RAD = 0.06, 0.02
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, CYCLES // 500 if CYCLES > 1000 else 1))]
"""Seeds of the arms: one by default, and twenty in ``make soak``."""


def pick_place(name: str) -> PickPlace:
    return load_pick_place(find_arm(name).pick_place)


@pytest.mark.parametrize("name", SCENES)
def test_joints_and_poses_come_from_the_scene(name: str) -> None:
    world, said = World(find_arm(name).scene), pick_place(name)
    assert world.joints == JOINTS
    assert tuple(world.ready) == (*said.poses.ready, said.hand_open_m)
    assert world.cell.cube_on_stand() and not world.cell.cube_touched()


@pytest.mark.parametrize("name", SCENES)
def test_scene_has_the_efforts_of_the_robot_file(name: str) -> None:
    def end() -> bytes:
        world, random = World(find_arm(name).scene), np.random.default_rng(1)
        for _ in range(500):
            world.step(0.3 * random.normal(size=6))
        return bytes(world.data.qpos.tobytes() + world.data.qvel.tobytes())

    assert end() == end()


@pytest.mark.parametrize("name", SCENES)
def test_a_limp_arm_stays_folded_and_leaves_the_cube_alone(name: str) -> None:
    world = World(find_arm(name).scene)
    start = world.position()
    for _ in range(5000):
        world.step([0.0] * 6)
    assert np.abs(world.position() - start).max() < 0.25
    assert np.abs(world.velocity()).max() < 0.01
    assert world.cell.cube_on_stand()


@pytest.mark.parametrize("name", SCENES)
def test_jaws_stay_clear_of_the_cube_from_ready_to_pick(name: str) -> None:
    said = pick_place(name)
    ready, pick = np.array(said.poses.ready), np.array(said.poses.pick)
    for share in np.linspace(0.0, 1.0, 41):
        position = [*(ready + share * (pick - ready)), said.hand_open_m]
        world = World(find_arm(name).scene, initial_position=position)
        assert world.cell.stand_free() and not world.cell.cube_touched()


@pytest.mark.parametrize("name", ARMS)
def test_its_servos_hold_the_ready_pose(name: str) -> None:
    files = read_arm_files(find_arm(name))
    ready = World(files.scene).ready
    rig = SimulatedStack(files=files, start=ready).up()
    rig.run(ACTIVATED_S)
    rig.go(ready[:-1])
    rig.run(5.0)
    assert np.abs(rig.world.position() - ready)[:-1].max() < 0.01


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((0.0, 0.0, -1.2, 0.0, 0.0, 0.5), (0.0, 0.9, -1.2, 0.0, 0.0)),
        ((0.0, -0.6, -1.4, 0.5, 0.0, 0.5), (0.0, -1.42, -1.49, 0.5, 0.0)),
    ],
)
@pytest.mark.parametrize("seed", [None, 2])
def test_an_arm_that_leans_out_reaches_its_goal(
    start: tuple[float, ...], goal: tuple[float, ...], seed: int | None
) -> None:
    """The weight increases the friction of the gears, which holds the arm above its goal."""
    rig = SimulatedStack(files=read_arm_files(find_arm("so101")), start=start, build=Build(seed=seed)).up()
    rig.run(ACTIVATED_S)
    handle = rig.go(goal)
    rig.run(6.0)
    assert handle.status is GoalStatus.SUCCEEDED
    assert np.abs(rig.world.position()[:-1] - goal).max() < 0.005


class SeenJob(UnpacedJob):
    """Job that checks the bins in each cycle, because a cube may be removed before the arm returns."""

    def __init__(self, rig: SimulatedStack, grade: str, settings: JobSettings) -> None:
        super().__init__(rig, grade, settings)
        self.lay: set[str | None] = set()

    def react(self) -> None:
        super().react()
        if not self._steps:  # the hand opens
            self.lay.add(self._rig.world.cube_bin())


def sorted_into(rig: SimulatedStack, name: str, grade: str) -> None:
    """Run one job. The cube must stay in the bin of its grade until it is removed."""
    job = SeenJob(rig, grade, pick_place(name).settings())
    job.run()
    rig.after_cycle = lambda: job.lay.add(rig.world.cube_bin())
    rig.run(1.0)
    assert [handle.status for handle in job.handles] == [GoalStatus.SUCCEEDED] * 4
    assert job.lay - {None} == {grade}
    rig.after_cycle = lambda: None


@pytest.mark.parametrize(
    ("name", "grade"),
    [pytest.param(*one, marks=() if one[0] == "so101" else pytest.mark.slow) for one in zip(ARMS, "ABCA", strict=True)],
)
def test_cube_lands_in_the_bin_of_its_grade(name: str, grade: str) -> None:
    """The tests below cover all three grades of every arm, with backlash."""
    rig = SimulatedStack(files=read_arm_files(find_arm(name))).up()
    rig.run(ACTIVATED_S)
    held: list[float] = []
    """Reduced drive of the jaw's servo, one value for each state that reports a stall."""
    rig.on_state = lambda state: held.extend(abs(one.load) for one in state.health.values() if one.stall)
    sorted_into(rig, name, grade)
    if name != "koch":  # the gain of the servo is too low to press with the full torque limit
        assert held and min(held) < 0.2
    error = rig.trace.following(since_s=ACTIVATED_S)
    assert max(error.largest_rad) < LARGEST_RAD
    assert max(error.rms_moving_rad) < RMS_RAD
    assert rig.loop.figures.missed == 0


@pytest.mark.parametrize("name", ["so101", *(pytest.param(name, marks=pytest.mark.slow) for name in ARMS[1:])])
@pytest.mark.parametrize("seed", SEEDS)
def test_any_arm_with_backlash_sorts_cube_after_cube(name: str, seed: int) -> None:
    """The arm is limp at first, as in the demo before the stack starts. The jobs follow each other without a pause."""
    rig = SimulatedStack(files=read_arm_files(find_arm(name)), build=Build(1.0, seed))
    for now_s in (0.0, 5.0):
        rig.bus.advance(now_s)
    rig.clock.sleep_until(5.0)
    rig.up()
    rig.run(ACTIVATED_S)
    for grade in GRADES:
        sorted_into(rig, name, grade)
