"""Place a new cube on a stand when the last cube is done and the arm starts to move again.

Apples are placed earlier, while the arm is at rest, because a camera must see an apple before the apple's job can
start.

Between two jobs, the arm is at rest at the ready pose, with its open fingers around the stand. The old cube stays in
place until the arm leaves for the next job, so that the cube can be seen and measured.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_backend.scene.cube_cell import CubeCell, FloatArray
from sim_backend.scene.world import World

LOOK_S: Final = 0.01
SLOW_RAD_S: Final = 0.05
"""Maximum speed at which a joint is considered at rest. A servo that holds its position vibrates slightly."""
SLOW_HAND_1_S: Final = 0.1
"""Maximum speed at which the hand is considered at rest, in multiples of its travel per second."""
STAYS_RAD: Final = 0.03
"""Maximum motion of a joint that is still considered at rest. The value exceeds the backlash, within which a joint can
oscillate."""
STAYS_HAND: Final = 0.1
"""Maximum motion of a hand that is considered at rest, as a fraction of its travel."""
AT_READY_RAD: Final = 0.15
OPEN: Final = 0.1
"""Maximum distance between an open hand and the ready pose, as a fraction of the hand's travel. The distance is much
larger when the hand holds a cube."""
REST_S: Final = 0.1
"""Minimum time at rest required in the ready pose, in seconds.

Between two jobs of a node, the arm is at rest only until the next goal arrives.
"""
SWINGING_REST_S: Final = 0.5
"""Minimum time at rest required if the arm oscillates in place, in seconds. While moving to the ready pose, the arm
never stays in one place this long."""
LONG_REST_S: Final = 10.0
"""Minimum time at rest required in other poses, in seconds. The time must be long, because the arm can pause during a
job."""
SHOWN_S: Final = 1.5
"""Time the old apple stays in its bin before the next apple is placed, in seconds."""


class Feeder:
    """Feeder that places cubes in all cells of one world. Call `update` after every step."""

    def __init__(self) -> None:
        self._next_s = 0.0
        self._cells: tuple[CellFeeder, ...] = ()

    @property
    def due(self) -> bool:
        """Whether a new cube is placed the next time an arm moves."""
        return any(cell.due for cell in self._cells)

    def update(self, world: World, time_s: float) -> None:
        """Place the cubes that are due. `time_s` is the world's time."""
        if time_s < self._next_s or not world.cells:
            return
        self._next_s = time_s + LOOK_S
        self._cells = self._cells or tuple(CellFeeder(cell, world.joints_of(cell)) for cell in world.cells)
        for cell in self._cells:
            cell.update(world, time_s)


class CellFeeder:
    """Feeder that places cubes in one cell, and tracks how long the arm has been at rest and whether a cube is due."""

    def __init__(self, cell: CubeCell, joints: NDArray[np.int64]) -> None:
        """``joints`` are the indices of the arm's joints in the world's joint order. The last joint is the hand."""
        self._cell, self._joints = cell, joints
        self._slow_since_s = self._stays_since_s = math.inf
        self._stays_at: FloatArray | None = None
        self._shown_until_s = math.inf
        self.due = False
        """Whether the old cube is done and the arm has been at rest long enough, so that the next motion triggers a new
        cube."""

    def update(self, world: World, time_s: float) -> None:
        """Place a cube if it is due and the cell has a stand."""
        if not self._cell.laid:
            return
        arm = _Arm(world, self._joints)
        if self.due and self._cell.tray is not None:
            self._feed_apple(time_s)
        elif self.due:
            self._feed(arm)
        elif _done(arm, self._cell):
            self._rest(arm, time_s)
        else:
            self._begin()

    def _begin(self) -> None:
        self._slow_since_s = self._stays_since_s = math.inf
        self._stays_at = None

    def _rest(self, arm: "_Arm", time_s: float) -> None:
        """Check whether the arm has been at rest long enough."""
        self._slow_since_s = min(self._slow_since_s, time_s) if arm.slow else math.inf
        if self._stays_at is None or not arm.stays_at(self._stays_at):
            self._stays_at, self._stays_since_s = arm.position, time_s
        slow_s, stays_s = time_s - self._slow_since_s, time_s - self._stays_since_s
        if arm.at_ready:
            self.due = slow_s >= REST_S or stays_s >= SWINGING_REST_S
        else:
            self.due = max(slow_s, stays_s) >= LONG_REST_S
        self._shown_until_s = time_s + SHOWN_S

    def _feed(self, arm: "_Arm") -> None:
        """Place a cube when the arm leaves its rest position and the stand is free.

        If the hand only opens or closes, a job has not started.
        """
        if self._stays_at is not None and arm.has_left(self._stays_at) and self._cell.stand_free():
            self._lay_next()

    def _feed_apple(self, time_s: float) -> None:
        """Feed an apple when the last apple has been in its bin for a while, even if the arm is at rest in another
        pose.

        After a failed job, the arm holds its pose. The next job starts by moving to the ready pose.
        """
        if time_s >= self._shown_until_s and self._cell.stand_free():
            self._lay_next()

    def _lay_next(self) -> None:
        self._cell.feed_cube()
        self.due = False
        self._begin()


class _Arm:
    """Present state of the arm at one cell."""

    def __init__(self, world: World, joints: NDArray[np.int64]) -> None:
        self.position = world.position()[joints]
        self._world, self._joints = world, joints
        self._hand_travel = float(world.travel[joints[-1]])

    @property
    def slow(self) -> bool:
        """Whether all joints are at rest."""
        speed = np.abs(self._world.velocity()[self._joints])
        return bool(speed[:-1].max() < SLOW_RAD_S and speed[-1] < SLOW_HAND_1_S * self._hand_travel)

    @property
    def at_ready(self) -> bool:
        """Whether the arm is near its ready pose, regardless of the hand."""
        return bool(np.abs((self.position - self._ready)[:-1]).max() < AT_READY_RAD)

    @property
    def hand_open(self) -> bool:
        """Whether the hand is open."""
        return bool(abs(self.position[-1] - self._ready[-1]) < OPEN * self._hand_travel)

    @property
    def _ready(self) -> FloatArray:
        ready: FloatArray = self._world.ready[self._joints]
        return ready

    def has_left(self, rest: FloatArray) -> bool:
        """Return whether the arm has left the position where it was at rest, ignoring the hand."""
        return bool(np.abs((self.position - rest)[:-1]).max() > STAYS_RAD)

    def stays_at(self, rest: FloatArray) -> bool:
        """Return whether the arm and the hand are still where they came to rest."""
        return not self.has_left(rest) and bool(abs(self.position[-1] - rest[-1]) < STAYS_HAND * self._hand_travel)


def _done(arm: _Arm, cell: CubeCell) -> bool:
    """Return whether the cube is done: in a bin or lost, and neither on the stand nor in the hand.

    After a failed job, the cube can lean against the open fingers around the stand.
    """
    if not cell.cube_at_rest() or cell.cube_on_stand():
        return False
    return not cell.cube_touched() or (arm.at_ready and arm.hand_open)
