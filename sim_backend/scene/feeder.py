"""When a fresh cube is laid on the stand: after the last one is done, as the arm sets out again.

Between two jobs the arm rests at ready, its open fingers around the stand. The old cube stays where it
ended until the arm leaves for the next job; so one can see (and measure) where it is.
"""

import math
from typing import Final

import numpy as np

from sim_backend.scene.cube_cell import CubeCell, FloatArray
from sim_backend.scene.world import World

LOOK_S: Final = 0.01
SLOW_RAD_S: Final = 0.05
"""Slower than this a joint is at rest. A servo that holds hums a little."""
SLOW_HAND_1_S: Final = 0.1
"""The same of the hand, in its whole travel a second."""
STAYS_RAD: Final = 0.03
"""A joint that stays within so much is at rest too: more than the backlash of its gears, in which it may swing."""
STAYS_HAND: Final = 0.1
"""The same of the hand, as a share of its travel."""
AT_READY_RAD: Final = 0.15
OPEN: Final = 0.1
"""The hand is open so near to where it is at ready, as a share of its travel; the cube stops it much further on."""
REST_S: Final = 0.1
"""At ready. A node that goes straight on to the next job rests no longer than its goal takes to arrive."""
SWINGING_REST_S: Final = 0.5
"""For an arm that is not slow, but stays: on its way to ready it never stays so long."""
LONG_REST_S: Final = 10.0
"""Away from ready a rest may be a pause within the job, so it must be this long to end one."""


class Feeder:
    """Call `update` after every step of one world. State: since when and where all rests, and whether a cube is due."""

    def __init__(self) -> None:
        self._next_s = 0.0
        self._slow_since_s = self._stays_since_s = math.inf
        self._stays_at: FloatArray | None = None
        self.due = False
        """The old cube is done and the arm has rested; the next motion brings a fresh one."""

    def update(self, world: World, time_s: float) -> None:
        """Feed a cube if it is time to, and there is a stand. `time_s`: the world's."""
        if time_s < self._next_s or world.cell is None or not world.cell.laid:
            return
        self._next_s = time_s + LOOK_S
        if self.due:
            self._feed(world, world.cell)
        elif _done(world, world.cell):
            self._rest(world, time_s)
        else:
            self._begin()

    def _begin(self) -> None:
        self._slow_since_s = self._stays_since_s = math.inf
        self._stays_at = None

    def _rest(self, world: World, time_s: float) -> None:
        """Look whether the rest has been long enough."""
        self._slow_since_s = min(self._slow_since_s, time_s) if _slow(world) else math.inf
        if self._stays_at is None or not _stays(self._stays_at, world):
            self._stays_at, self._stays_since_s = world.position(), time_s
        slow_s, stays_s = time_s - self._slow_since_s, time_s - self._stays_since_s
        if _at_ready(world):
            self.due = slow_s >= REST_S or stays_s >= SWINGING_REST_S
        else:
            self.due = max(slow_s, stays_s) >= LONG_REST_S

    def _feed(self, world: World, cell: CubeCell) -> None:
        """Wait while a finger is in the way; a hand that only opens and closes is no new job."""
        if self._stays_at is not None and _set_out(self._stays_at, world) and cell.stand_free():
            cell.feed_cube()
            self.due = False
            self._begin()


def _slow(world: World) -> bool:
    speed = np.abs(world.velocity())
    return bool(speed[:-1].max() < SLOW_RAD_S and speed[-1] < SLOW_HAND_1_S * world.hand_travel)


def _set_out(rest: FloatArray, world: World) -> bool:
    """Whether the arm has left where it rested, whatever the hand does."""
    return bool(np.abs((world.position() - rest)[:-1]).max() > STAYS_RAD)


def _stays(rest: FloatArray, world: World) -> bool:
    return not _set_out(rest, world) and bool(abs(world.position()[-1] - rest[-1]) < STAYS_HAND * world.hand_travel)


def _done(world: World, cell: CubeCell) -> bool:
    """Whether the cube ended its way: in a bin or lost, but not on the stand and not in the hand.

    A job that failed may leave it leaning against the fingers that are open around the stand.
    """
    if not cell.cube_at_rest() or cell.cube_on_stand():
        return False
    return not cell.cube_touched() or (_at_ready(world) and _open(world))


def _at_ready(world: World) -> bool:
    return bool(np.abs((world.position() - world.ready)[:-1]).max() < AT_READY_RAD)


def _open(world: World) -> bool:
    return bool(abs(world.position()[-1] - world.ready[-1]) < OPEN * world.hand_travel)
