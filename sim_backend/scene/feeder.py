"""Put a new cube on the stand after the last cube is done, when the arm starts to move again.

Apples are placed earlier, while the arm is at rest, because a camera must see an apple before a job for it can start.

Between two jobs, the arm is at rest at the ready pose, with its open fingers around the stand. The old cube stays in
place until the arm leaves for the next job, so that it can be seen and measured.
"""

import math
from typing import Final

import numpy as np

from sim_backend.scene.cube_cell import CubeCell, FloatArray
from sim_backend.scene.world import World

LOOK_S: Final = 0.01
SLOW_RAD_S: Final = 0.05
"""Maximum speed of a joint at rest. A servo that holds its position vibrates slightly."""
SLOW_HAND_1_S: Final = 0.1
"""Maximum speed of the hand at rest, in multiples of its travel per second."""
STAYS_RAD: Final = 0.03
"""Maximum motion of a joint that also counts as at rest. The value exceeds the backlash, within which a joint can
oscillate."""
STAYS_HAND: Final = 0.1
"""Maximum motion of the hand at rest, as a share of its travel."""
AT_READY_RAD: Final = 0.15
OPEN: Final = 0.1
"""Maximum distance of an open hand from the ready pose, as a share of its travel. With a cube in the hand, the distance
is much larger."""
REST_S: Final = 0.1
"""Time at rest in the ready pose. A node that continues with the next job stays at rest only until its goal arrives."""
SWINGING_REST_S: Final = 0.5
"""Time at rest for an arm that oscillates in place. On the way to the ready pose, the arm never stays in one place for
this time."""
LONG_REST_S: Final = 10.0
"""Time at rest in other poses. This time is long, because the arm can also pause in another pose during a job."""
SHOWN_S: Final = 1.5
"""Time that the old apple stays in its bin before the next apple is placed."""


class Feeder:
    """Feeds cubes to one world.

    Call `update` after every step. The feeder records since when the arm has been at rest, and whether a cube is due.
    """

    def __init__(self) -> None:
        self._next_s = 0.0
        self._slow_since_s = self._stays_since_s = math.inf
        self._stays_at: FloatArray | None = None
        self._shown_until_s = math.inf
        self.due = False
        """Whether the old cube is done and the arm has been at rest, so that a new cube is placed at the next
        motion."""

    def update(self, world: World, time_s: float) -> None:
        """Place a cube if it is due and the scene has a stand. `time_s` is the time of the world."""
        if time_s < self._next_s or world.cell is None or not world.cell.laid:
            return
        self._next_s = time_s + LOOK_S
        if self.due and world.cell.tray is not None:
            self._feed_apple(world, world.cell, time_s)
        elif self.due:
            self._feed(world, world.cell)
        elif _done(world, world.cell):
            self._rest(world, time_s)
        else:
            self._begin()

    def _begin(self) -> None:
        self._slow_since_s = self._stays_since_s = math.inf
        self._stays_at = None

    def _rest(self, world: World, time_s: float) -> None:
        """Check whether the arm has been at rest long enough."""
        self._slow_since_s = min(self._slow_since_s, time_s) if _slow(world) else math.inf
        if self._stays_at is None or not _stays(self._stays_at, world):
            self._stays_at, self._stays_since_s = world.position(), time_s
        slow_s, stays_s = time_s - self._slow_since_s, time_s - self._stays_since_s
        if _at_ready(world):
            self.due = slow_s >= REST_S or stays_s >= SWINGING_REST_S
        else:
            self.due = max(slow_s, stays_s) >= LONG_REST_S
        self._shown_until_s = time_s + SHOWN_S

    def _feed(self, world: World, cell: CubeCell) -> None:
        """Place a cube when the arm leaves and the stand is free.

        A hand that only opens or closes does not start a job.
        """
        if self._stays_at is not None and _set_out(self._stays_at, world) and cell.stand_free():
            self._lay_next(cell)

    def _feed_apple(self, world: World, cell: CubeCell, time_s: float) -> None:
        """Place an apple when the last one has been in its bin for a while, even if the arm is at rest in another pose.

        The arm of a failed job holds its pose. The next job starts by moving to the ready pose.
        """
        if time_s >= self._shown_until_s and cell.stand_free():
            self._lay_next(cell)

    def _lay_next(self, cell: CubeCell) -> None:
        cell.feed_cube()
        self.due = False
        self._begin()


def _slow(world: World) -> bool:
    speed = np.abs(world.velocity())
    return bool(speed[:-1].max() < SLOW_RAD_S and speed[-1] < SLOW_HAND_1_S * world.hand_travel)


def _set_out(rest: FloatArray, world: World) -> bool:
    """Whether the arm has left the pose in which it was at rest, regardless of the hand."""
    return bool(np.abs((world.position() - rest)[:-1]).max() > STAYS_RAD)


def _stays(rest: FloatArray, world: World) -> bool:
    return not _set_out(rest, world) and bool(abs(world.position()[-1] - rest[-1]) < STAYS_HAND * world.hand_travel)


def _done(world: World, cell: CubeCell) -> bool:
    """Whether the cube is done: in a bin or lost, but not on the stand and not in the hand.

    After a failed job, the cube can lean against the open fingers around the stand.
    """
    if not cell.cube_at_rest() or cell.cube_on_stand():
        return False
    return not cell.cube_touched() or (_at_ready(world) and _open(world))


def _at_ready(world: World) -> bool:
    return bool(np.abs((world.position() - world.ready)[:-1]).max() < AT_READY_RAD)


def _open(world: World) -> bool:
    return bool(abs(world.position()[-1] - world.ready[-1]) < OPEN * world.hand_travel)
