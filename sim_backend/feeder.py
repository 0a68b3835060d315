"""When a fresh cube is laid on the stand: after the last one is done, as the arm sets out again.

Between two jobs the arm rests at ready, its open fingers around the stand. The old cube stays where it
ended until the arm leaves for the next job; so one can see (and measure) where it is.
"""

from typing import Final

import numpy as np

from sim_backend.world import FloatArray, World

LOOK_S: Final = 0.01
STILL_RAD: Final = 0.03
"""A joint that stays within so much is at rest: more than the backlash of its gears, in which it may swing."""
STILL_HAND: Final = 0.1
"""The same of the hand, as a share of its travel."""
AT_READY_RAD: Final = 0.15
OPEN: Final = 0.1
"""The hand is open so near to where it is at ready, as a share of its travel; the cube stops it much further on."""
REST_S: Final = 0.5
"""At ready, where a node that goes straight on to the next job first sends the arm, which takes its time."""
LONG_REST_S: Final = 10.0
"""Away from ready a rest may be a pause within the job, so it must be this long to end one."""


class Feeder:
    """Call `update` after every step of one world. State: since when all rests, where, and whether a cube is due."""

    def __init__(self) -> None:
        self._next_s = 0.0
        self._rest_since_s = 0.0
        self._rest_at: FloatArray | None = None
        self.due = False
        """The old cube is done and the arm has rested; the next motion brings a fresh one."""

    def update(self, world: World, time_s: float) -> None:
        """Feed a cube if it is time to. `time_s`: the world's."""
        if time_s < self._next_s:
            return
        self._next_s = time_s + LOOK_S
        if self.due:
            self._feed(world)
        elif not _done(world):
            self._rest_at = None
        else:
            self._rest(world, time_s)

    def _rest(self, world: World, time_s: float) -> None:
        position = world.position()
        if self._rest_at is None or _left(self._rest_at, position, world.hand_travel):
            self._rest_at, self._rest_since_s = position, time_s
        needed_s = REST_S if _at_ready(world) else LONG_REST_S
        self.due = time_s - self._rest_since_s >= needed_s

    def _feed(self, world: World) -> None:
        """Wait while a finger is in the way; a hand that only opens and closes is no new job."""
        if self._rest_at is not None and _moved(self._rest_at, world.position()) and world.stand_free():
            world.feed_cube()
            self.due = False
            self._rest_at = None


def _moved(rest: FloatArray, position: FloatArray) -> bool:
    """Whether the arm has set out, whatever the hand does."""
    return bool(np.abs((position - rest)[:-1]).max() > STILL_RAD)


def _left(rest: FloatArray, position: FloatArray, hand_travel: float) -> bool:
    return _moved(rest, position) or bool(abs(position[-1] - rest[-1]) > STILL_HAND * hand_travel)


def _done(world: World) -> bool:
    """Whether the cube ended its way: in a bin or lost, but not on the stand and not in the hand.

    A job that failed may leave it leaning against the fingers that are open around the stand.
    """
    in_hand = world.cube_touched() and not (_at_ready(world) and _open(world))
    return world.cube_at_rest() and not world.cube_on_stand() and not in_hand


def _at_ready(world: World) -> bool:
    return bool(np.abs((world.position() - world.ready)[:-1]).max() < AT_READY_RAD)


def _open(world: World) -> bool:
    return bool(abs(world.position()[-1] - world.ready[-1]) < OPEN * world.hand_travel)
