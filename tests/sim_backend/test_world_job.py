"""The whole job in the world: with simple servos, the cube ends in its bin even if the joints have errors.

The servos are proportional with limited drive and back-EMF, and each of them measures its joint with a constant error.
The hand may still be closing when the arm starts to move.
"""

from typing import Final

import numpy as np
import pytest

from sim_backend.scene.world import World
from tests.sim_backend.robot_arm import READY

STALL_NM: Final = 2.94
NO_LOAD_RAD_S: Final = 4.71
RACK_M_RAD: Final = 0.03
HAND_M_S: Final = 0.09
MOTION_S: Final = 2.0
SETTLE_S: Final = 1.0
OPEN, CLOSED = 0.0, 0.05
PICK: Final = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
BINS: Final = {
    "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
    "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
}


def linear(s):
    return s


def quintic(s):
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def trapezoid(s, ramp=0.3):
    """Return the position at time `s`, both as fractions of the motion. Acceleration and braking have limited jerk, and
    each takes the fraction `ramp` of the time."""
    if s > 0.5:
        return 1.0 - trapezoid(1.0 - s, ramp)
    x = min(1.0, s / ramp)
    return (ramp * (x**3 - x**4 / 2.0) + max(0.0, s - ramp)) / (1.0 - ramp)


class Servos:
    """Seven servos on a world. `error_rad` contains the measurement errors of the arm's servos. The servo of the hand
    uses at most half of its drive."""

    def __init__(self, world, error_rad):
        self.world = world
        self.wrong = np.append(error_rad, 0.0)
        self.hand = 0.0
        self.unit = np.array([1.0] * 6 + [RACK_M_RAD])
        self.limit = np.array([1.0] * 6 + [0.5]) * STALL_NM

    def step(self, arm, hand):
        reach = HAND_M_S * self.world.timestep_s
        self.hand += min(max(hand - self.hand, -reach), reach)
        error = (np.append(arm, self.hand) + self.wrong - self.world.position()) / self.unit
        speed = self.world.velocity() / self.unit
        # Gravity is compensated, so that the error is the one that the test requests.
        gravity = self.world.data.qfrc_bias[self.world._qvel] * self.unit
        drive = np.clip(48.0 * error - 0.5 * speed + gravity, -self.limit, self.limit)
        self.world.step((drive - STALL_NM / NO_LOAD_RAD_S * speed) / self.unit)


def do_job(grade, profile, wait_s, error_rad=(0.0,) * 6):
    """Pick the cube, close, move to the bin, open, and return to ready, with a pause of `wait_s` after each hand
    command. Return the place where the cube ended."""
    world = World()
    servos = Servos(world, np.array(error_rad))
    steps = round(MOTION_S / world.timestep_s)
    here, hand = np.array(READY[:6]), OPEN
    for target, hand_then in ((PICK, CLOSED), (BINS[grade], OPEN), (READY[:6], OPEN)):
        way = np.array(target) - here
        for i in range(steps):
            servos.step(here + profile((i + 1) / steps) * way, hand)
        here, hand = here + way, hand_then
        for _ in range(round(wait_s / world.timestep_s)):
            servos.step(here, hand)
    for _ in range(round(SETTLE_S / world.timestep_s)):
        servos.step(here, hand)
    return world.cube_bin()


@pytest.mark.parametrize(("profile", "wait_s"), [(linear, 0.0), (quintic, 0.4), (trapezoid, 0.4)])
@pytest.mark.parametrize("grade", BINS)
def test_the_cube_ends_in_its_bin(grade, profile, wait_s):
    assert do_job(grade, profile, wait_s) == grade


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("grade", BINS)
def test_the_cube_ends_in_its_bin_despite_joint_errors(grade, seed):
    """Each joint has an error of up to 0.03 rad. Fast and slow motions alternate."""
    error_rad = np.random.default_rng(seed).uniform(-0.03, 0.03, 6)
    profile, wait_s = (quintic, 0.4) if seed % 2 else (linear, 0.0)
    assert do_job(grade, profile, wait_s, error_rad) == grade
