"""Relief: after a goal has ended, a joint that something holds gives way until it presses no more.

The arm first brakes along its path. Then the command of each joint that rests short of it goes back, slowly, to where
that joint is measured. A joint that moves along is not held; its command stops, so that a stop never becomes a motion.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from controller.motion import Kinematics, MotionError, motion_to
from controller.trajectory.active_goal import Cycle
from controller.trajectory.rest import HELD_S, LONGEST_REST_S, RESTS_S, Rest
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.waypoints import BoolArray
from hal.types import FloatArray

LOG = logging.getLogger("servoloop.controller")

PRESSES: Final = 15.0
"""A joint presses if it rests further from its command than so many times what counts as no motion."""
LOOSE: Final = 5.0
"""A joint is free if it moves by more than so many times what counts as no motion."""
FOLLOWS_SHARE: Final = 0.5
"""Share of the command's way back that a held joint may move along, because its link and the obstacle are elastic."""
JERK_SHARE: Final = 0.25
"""Share of the jerk limit with which a command goes back: it begins so slowly that a free joint is noticed in time."""


class Relief:
    """The relief of one trajectory's joints. In the loop's thread."""

    def __init__(self, name: str, joints: Sequence[str], sampler: TrajectorySampler) -> None:
        self.due = False
        """Whether the joints are still to come to rest, or to be relieved."""
        self._name, self._joints, self._sampler = name, tuple(joints), sampler
        self._limits = [replace(limit, jerk=JERK_SHARE * limit.jerk) for limit in sampler.limits]
        self._rest = Rest(sampler.still)
        self._stood_s = 0.0
        self._relieved = np.zeros(len(joints), dtype=np.bool_)
        self._begun: Cycle | None = None
        """The cycle in which commands began to go back; None while none does."""

    def begin(self) -> None:
        """A goal has ended, and its joints brake."""
        self.due, self._begun = True, None
        self._relieved[:] = False
        self._rest, self._stood_s = Rest(self._sampler.still), 0.0

    @property
    def done(self) -> bool:
        """Whether a goal may end: the joints rest, or their time to come to rest is over."""
        return not self.due or self._stood_s > LONGEST_REST_S

    def step(self, now: Cycle) -> None:
        """Run one cycle in which relief is due."""
        unknown = np.array([now.waits or name in now.state.faults for name in self._joints])
        self._rest.look(np.where(unknown, np.nan, measured(now)), now.step_s)
        if now.waits and self._begun:
            self._begun, self._relieved = None, np.zeros_like(self._relieved)  # the arm stands at the last command
        if self._begun and (free := self._come_free(self._begun, now, ~unknown)).any():
            # All commands stop; a joint that is still held is relieved again, once it is seen to be.
            self._relieved &= free | (now.reference.position == self._begun.reference.position)
            self._sampler.stop(now.reference, now.parameters)
            self._begun = None
        if not self._sampler.stands:
            return
        self._begun = None
        self._stood_s += now.step_s
        off = np.abs(now.error) > PRESSES * self._sampler.still
        held = off & self._rest.for_at_least(HELD_S) & ~self._relieved
        if held.any():
            self._relieve(held, now)
        else:  # a joint that creeps may still come to press
            self.due = not (self._rest.for_at_least(RESTS_S) & (~off | self._relieved)).all()

    def _relieve(self, held: BoolArray, now: Cycle) -> None:
        """Begin to bring the commands of the ``held`` joints (n,) back to where these are."""
        for index in np.flatnonzero(held):
            text = "%s: %s is held %.4f short of its command, which goes back so that it does not press"
            LOG.warning(text, self._name, self._joints[index], abs(now.error[index]))
        self._relieved |= held
        target = self._sampler.inside(np.where(held, measured(now), now.reference.position))
        try:
            back = motion_to(now.reference, Kinematics.at_rest(target), self._limits, 0.0)
        except MotionError as error:
            LOG.error("%s: no way back from what holds a joint: %s", self._name, error)
            return
        self._sampler.follow(back, now.reference, on_goal=False)
        self._begun, self._stood_s = now, 0.0

    def _come_free(self, begun: Cycle, now: Cycle, known: BoolArray) -> BoolArray:
        """The joints (n,) whose commands go back and that move by more than held ones can."""
        back = begun.reference.position - now.reference.position
        forth = (measured(now) - measured(begun)) * np.sign(begun.error)
        loose = LOOSE * self._sampler.still
        free: BoolArray = (forth > loose) | (-forth > np.maximum(loose, FOLLOWS_SHARE * np.abs(back)))
        free &= known & (back != 0.0)
        return free


def measured(now: Cycle) -> FloatArray:
    """The measured positions (n,); of a joint without ends those in the turn of its reference."""
    position: FloatArray = now.reference.position - now.error
    return position
