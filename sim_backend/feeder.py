"""When a fresh cube is laid on the stand: after the last one is done, as the arm sets out again.

Between two jobs the arm rests at ready, its open fingers around the stand. The old cube stays where it
ended until the arm leaves for the next job; so one can see (and measure) where it is.
"""

from typing import Final

import numpy as np

from sim_backend.world import READY, FloatArray, World

LOOK_S: Final = 0.01
STILL: Final = np.array([0.05] * 6 + [0.005])
"""Slower than this is at rest: rad/s, the last one m/s. A servo that holds hums a little."""
SETS_OUT_RAD_S: Final = 0.1
AT_READY_RAD: Final = 0.15
OPEN_M: Final = 0.005
"""The driven finger's way; closed around the cube it has gone nearly 0.03 m."""
REST_S: Final = 0.1
"""At ready. A node that goes straight on to the next job rests no longer than its goal takes to arrive."""
LONG_REST_S: Final = 10.0
"""Away from ready a rest may be a pause within the job, so it must be this long to end one."""


class Feeder:
    """Call `update` after every step of one world. State: how long all has been at rest, and whether a cube is due."""

    def __init__(self) -> None:
        self._next_s = 0.0
        self._rest_since_s: float | None = None
        self.due = False
        """The old cube is done and the arm has rested; the next motion brings a fresh one."""

    def update(self, world: World, time_s: float) -> None:
        """Feed a cube if it is time to. `time_s`: the world's."""
        if time_s < self._next_s:
            return
        self._next_s = time_s + LOOK_S
        speed = np.abs(world.velocity())
        if self.due:
            self._feed(world, speed)
        elif (speed < STILL).all() and _done(world):
            self._rest(world, time_s)
        else:
            self._rest_since_s = None

    def _rest(self, world: World, time_s: float) -> None:
        if self._rest_since_s is None:
            self._rest_since_s = time_s
        needed_s = REST_S if _at_ready(world.position()) else LONG_REST_S
        self.due = time_s - self._rest_since_s >= needed_s

    def _feed(self, world: World, speed: FloatArray) -> None:
        """Wait while a finger is in the way; a hand that only opens and closes is no new job."""
        if speed[:6].max() > SETS_OUT_RAD_S and world.stand_free():
            world.feed_cube()
            self.due = False
            self._rest_since_s = None


def _done(world: World) -> bool:
    """Whether the cube ended its way: in a bin or lost, but not on the stand and not in the hand.

    A job that failed may leave it leaning against the fingers that are open around the stand.
    """
    position = world.position()
    in_hand = world.cube_touched() and not (_at_ready(position) and position[6] < OPEN_M)
    return world.cube_at_rest() and not world.cube_on_stand() and not in_hand


def _at_ready(position: FloatArray) -> bool:
    return bool(np.abs(position[:6] - READY[:6]).max() < AT_READY_RAD)
