"""The rule for placing the next cube, tested on a fake world and once on the simulated world."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from sim_backend.scene.cube_cell import Tray
from sim_backend.scene.feeder import Feeder
from sim_backend.scene.world import World
from tests.sim_backend.robot_arm import READY

PICK = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55, 0.0)
BIN = (0.4, -0.2, -0.8, -0.6, -1.1, 1.55, 0.0)
DT_S = 0.005
SWING_RAD_S = 2.0 * math.pi * 1.7


@dataclass
class PaperWorld:
    """Fake world. The test sets the properties that the feeder reads."""

    place: str = "bin"
    at_rest: bool = True
    touched: bool = False
    free: bool = True
    pose: tuple = READY
    speed: list = field(default_factory=lambda: [0.0] * 7)
    fed: int = 0
    time_s: float = 0.0
    ready = np.array(READY)
    travel = np.array([6.0] * 6 + [0.05])
    laid = True
    tray: Tray | None = None

    @property
    def cells(self):
        return (self,)

    def joints_of(self, cell):
        return np.arange(7)

    def velocity(self):
        return np.array(self.speed)

    def position(self):
        return np.array(self.pose)

    def cube_at_rest(self):
        return self.at_rest

    def cube_on_stand(self):
        return self.place == "stand" and self.at_rest

    def cube_touched(self):
        return self.touched

    def stand_free(self):
        return self.free

    def feed_cube(self):
        self.place, self.fed = "stand", self.fed + 1


@pytest.fixture
def world():
    return PaperWorld()


@pytest.fixture
def run(world):
    feeder = Feeder()

    def go(seconds, joint=None, speed=0.0, swing_rad=0.0):
        rest, world.speed = world.pose, [0.0] * 7
        if joint is not None:
            world.speed[joint] = speed
        for _ in range(round(seconds / DT_S)):
            world.time_s += DT_S
            if joint is not None:
                world.pose = list(world.pose)
                world.pose[joint] += speed * DT_S
            if swing_rad:
                phase = SWING_RAD_S * world.time_s
                world.speed[0] = swing_rad * SWING_RAD_S * math.cos(phase)
                world.pose = [rest[0] + swing_rad * math.sin(phase), *rest[1:]]
            feeder.update(world, world.time_s)
        return world.fed

    return go


def test_the_old_cube_stays_while_the_arm_rests(run):
    assert run(60.0) == 0


def test_an_arm_that_leaves_after_a_rest_gets_one_new_cube(run):
    run(1.1)
    assert run(2.0, joint=5, speed=1.0) == 1
    assert run(5.0) == 1


def test_a_short_rest_brings_no_cube(run):
    run(0.05)
    assert run(2.0, joint=5, speed=1.0) == 0


def test_the_rest_starts_when_the_cube_is_at_rest(run, world):
    world.at_rest = False
    run(5.0)
    world.at_rest = True
    run(0.05)
    assert run(1.0, joint=0, speed=0.5) == 0


def test_a_pause_above_the_bin_does_not_end_the_job(run, world):
    world.pose = BIN
    run(5.0)
    assert run(1.0, joint=0, speed=0.5) == 0
    run(11.0)
    assert run(1.0, joint=0, speed=0.5) == 1


@pytest.mark.parametrize(
    "cube",
    [
        {"place": "stand"},
        {"touched": True, "pose": (*READY[:6], 0.027)},
        {"touched": True, "pose": (*PICK[:6], 0.0)},
        {"at_rest": False},
    ],
)
def test_a_cube_that_is_not_done_stays(run, world, cube):
    vars(world).update(cube)
    run(20.0)
    assert run(2.0, joint=5, speed=1.0) == 0


def test_a_cube_leaning_against_the_open_hand_at_ready_is_done(run, world):
    """A failed job has left the cube against the open hand, and the arm has returned to the ready pose without the
    cube."""
    world.touched = True
    run(1.0)
    assert run(2.0, joint=5, speed=1.0) == 1


def test_a_moving_hand_does_not_start_a_new_job(run):
    run(2.0)
    assert run(2.0, joint=6, speed=0.08) == 0


def test_a_joint_that_swings_within_its_backlash_is_at_rest(run):
    assert run(2.0, swing_rad=0.012) == 0
    assert run(0.2, joint=3, speed=0.3) == 1


def test_an_arm_on_its_way_to_ready_is_not_at_rest(run, world):
    world.pose = [*READY[:5], READY[5] - 0.1, 0.0]
    run(1.0, joint=5, speed=0.1)
    assert run(0.5, joint=5, speed=0.1) == 0


def test_no_cube_is_fed_into_a_finger(run, world):
    run(2.0)
    world.free = False
    assert run(0.1, joint=5, speed=1.0) == 0
    world.free = True
    assert run(0.1, joint=5, speed=1.0) == 1


def test_a_simulated_world_gets_a_cube_when_the_arm_leaves_ready():
    world, feeder = World(), Feeder()
    world.data.qpos[world.cell.qpos][:3] = (0.29, 0.123, 0.03)
    goal = np.array(READY)

    def hold(seconds):
        for _ in range(round(seconds / world.timestep_s)):
            stiffness, damping = np.array([48.0] * 6 + [3000.0]), np.array([1.0] * 6 + [600.0])
            gravity = world.data.qfrc_bias[world._qvel]
            world.step(stiffness * (goal - world.position()) - damping * world.velocity() + gravity)
            feeder.update(world, world.time_s)

    hold(1.8)
    assert world.cube_bin() == "A" and feeder.due
    goal = np.array([*READY[:5], READY[5] + 0.3, 0.0])
    hold(0.2)
    assert world.cell.cube_on_stand() and not feeder.due
    assert not world.cell.cube_touched()


@pytest.fixture
def tray(world):
    world.tray = Tray(seed=1, diameters_mm=(50.0, 60.0))


@pytest.mark.usefixtures("tray")
def test_an_apple_comes_while_the_arm_rests(run, world):
    assert run(1.0) == 0, "the old apple stays in view for a while"
    assert run(1.5) == 1
    assert run(60.0) == 1, "no further apple comes while one is on the stand"
    world.place = "bin"
    assert run(2.5) == 2


@pytest.mark.usefixtures("tray")
def test_no_apple_comes_into_the_arm(run, world):
    world.free = False
    assert run(20.0) == 0
    world.free = True
    assert run(0.02) == 1


@pytest.mark.usefixtures("tray")
def test_no_apple_comes_in_a_pause_above_the_bin(run, world):
    world.pose = BIN
    assert run(5.0) == 0


@pytest.mark.usefixtures("tray")
def test_an_apple_comes_after_a_failed_job(run, world):
    world.pose = BIN
    assert run(15.0) == 1
