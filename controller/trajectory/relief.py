"""Relieve joints that press against an obstacle after a goal has ended.

The arm first brakes along its path. If a joint comes to rest before it reaches its command, the command then moves back
slowly to the measured position. If the joint moves along with its command, the joint is free. The command then stops,
so that the relief never turns into a motion of its own.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from controller.motion import Kinematics, MotionError, motion_to
from controller.trajectory.active_goal import Cycle
from controller.trajectory.rest import HELD_S, LONGEST_REST_S, LONGEST_SLIDE_S, RESTS_S, Rest
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.waypoints import BoolArray
from hal.types import FloatArray

LOG = logging.getLogger("servoloop.controller")

PRESSES: Final = 15.0
"""Minimum following error at which a joint at rest counts as pressing, in multiples of the still threshold."""
CREEPS_SHARE: Final = 0.05
"""Maximum motion of a joint that counts as at rest, as a fraction of its following error. A blocked joint may slide
slowly along its obstacle, but a free joint soon covers a larger part of the distance to its command."""
LOOSE: Final = 5.0
"""Minimum motion that indicates that a joint is free, in multiples of the still threshold."""
FOLLOWS_SHARE: Final = 0.5
"""Fraction of the command's return that a blocked joint may follow, because its link and the obstacle are elastic."""
GROWS: Final = 1.25
"""Minimum factor by which the distance between a seemingly free joint and its command must grow to indicate that a
neighbor has pushed the joint. The factor is relative to the distance before the command moved back."""
GROWS_AGAIN: Final = 1.4
"""The same factor, but relative to the smallest distance while the command moved back. A free joint lags behind its
command at this time, so the distance also grows slightly if no neighbor pushes the joint.
"""
SHRINKS: Final = 0.8
"""Factor by which the distance between a seemingly free joint and its command must shrink to indicate that the joint is
blocked after all. A free joint moves as far as its command, but a blocked joint that a neighbor moved for a moment
stays where it is. The factor is relative to the distance before the command moved back.
"""
ANY_ERROR: Final = np.array([[0.0], [np.inf]])
"""Range of following errors (2, 1) of joints that have not been found to be free."""
ATTEMPTS: Final = 5
"""Maximum number of times that a joint is relieved. A joint that moves while its neighbors are relieved may still be
blocked afterward, so one attempt is not enough.
"""
JERK_SHARE: Final = 0.25
"""Fraction of the jerk limit to use for the return motion. The slow start leaves enough time to detect a free joint."""
SPEED_SHARE: Final = 0.5
"""Fraction of the velocity limit used for the return, which matters only for a joint that is far from its command."""


class Relief:
    """Relief of one trajectory controller's joints, which runs in the loop thread."""

    def __init__(self, name: str, joints: Sequence[str], sampler: TrajectorySampler) -> None:
        self.due = False
        """Whether joints still have to come to rest or be relieved."""
        self._name, self._joints, self._sampler = name, tuple(joints), sampler
        self._limits = [
            replace(limit, jerk=JERK_SHARE * limit.jerk, velocity=SPEED_SHARE * limit.velocity)
            for limit in sampler.limits
        ]
        self._rest = Rest(sampler.still)
        self._stood_s = 0.0
        self._slides = False
        """Whether a measured joint is away from its command and still moves."""
        self._relieved = np.zeros(len(joints), dtype=np.bool_)
        self._attempts = np.zeros(len(joints), dtype=np.int64)
        self._free_error = np.repeat(ANY_ERROR, len(joints), axis=1)
        """Minimum and maximum following error (2, n) at which each joint that was found to be free still counts as
        free."""
        self._first_error = np.full(len(joints), np.inf)
        """Following error (n,) when the commands started to move back."""
        self._least_error = np.full(len(joints), np.inf)
        """Smallest following error (n,) since the commands started to move back."""
        self._limp = np.zeros(len(joints), dtype=np.bool_)
        """Joints (n,) that have lost their torque."""
        self._begun = False
        """Whether the commands are moving back."""
        self._from_command, self._from_position = np.zeros(len(joints)), np.zeros(len(joints))
        """Commands and measured positions (n,) from which the motion of the joints is measured."""

    def begin(self) -> None:
        """Start the relief after a goal ends. The joints may still be braking."""
        self.due, self._begun = True, False
        self._relieved[:] = False
        self._attempts[:] = 0
        self._free_error[:] = ANY_ERROR
        self._rest, self._stood_s = Rest(self._sampler.still), 0.0

    @property
    def done(self) -> bool:
        """Whether the goal may end, because the joints are at rest or have had enough time to come to rest."""
        return not self.due or self._stood_s > LONGEST_REST_S

    @property
    def goes_on(self) -> bool:
        """Whether joints without a goal still have to be relieved. A joint that slides along an obstacle gets more time
        to come to rest."""
        return self.due and self._stood_s <= (LONGEST_SLIDE_S if self._slides else LONGEST_REST_S)

    def step(self, now: Cycle) -> None:
        """Run one cycle while relief is due."""
        faults = now.state.faults
        unknown = np.array([now.waits or name in faults for name in self._joints])
        self._note_limp(np.array([name in faults and faults[name].kind == "no_torque" for name in self._joints]))
        creeps = CREEPS_SHARE * np.abs(now.error)
        self._rest.update(np.where(unknown, np.nan, measured(now)), now.step_s, creeps)
        if now.waits and self._begun:
            self._begun, self._relieved = False, np.zeros_like(self._relieved)  # The arm rests at the last command.
        if self._begun:
            self._stop_if_joints_move(now, ~unknown, self._limp)
        if not self._sampler.ended:
            return
        if self._begun:  # The commands have moved back. A joint that keeps sliding may press again.
            self._relieved &= self._attempts >= ATTEMPTS
            self._begun = False
        self._stood_s += now.step_s
        # A joint that is blocked outside its limits cannot be relieved further than to the limit.
        off = np.abs(now.reference.position - self._sampler.inside(measured(now))) > PRESSES * self._sampler.still
        least, most = self._free_error
        held_again = ((np.abs(now.error) < least) | (np.abs(now.error) > most)) & (self._attempts < ATTEMPTS)
        self._slides = bool((off & ~unknown & ~self._rest.for_at_least(HELD_S)).any())
        held = off & self._rest.for_at_least(HELD_S) & (~self._relieved | held_again)
        if held.any():
            self._relieve(held, now)
        else:  # A joint that creeps may still reach an obstacle.
            settled = ~off | (self._relieved & ~held_again)
            self.due = not (self._rest.for_at_least(RESTS_S) & settled).all()

    def _note_limp(self, limp: BoolArray) -> None:
        """Examine the joints again when a joint has become limp. Its neighbors may have moved only for this reason."""
        if (limp & ~self._limp).any():
            self._relieved &= self._attempts >= ATTEMPTS
            self._free_error[:] = ANY_ERROR
        self._limp = limp

    def _relieve(self, held: BoolArray, now: Cycle) -> None:
        """Start moving the commands of the ``held`` joints (n,) back to the measured positions."""
        for index in np.flatnonzero(held):
            text = "%s: %s is blocked %.4f short of its command: the command moves back to relieve the joint"
            LOG.warning(text, self._name, self._joints[index], abs(now.error[index]))
        self._relieved |= held
        self._free_error[:, held] = ANY_ERROR
        self._attempts += held
        target = self._sampler.inside(np.where(held, measured(now), now.reference.position))
        try:
            back = motion_to(now.reference, Kinematics.at_rest(target), self._limits, 0.0)
        except MotionError as error:
            LOG.error("%s: cannot relieve the blocked joints: %s", self._name, error)
            return
        self._sampler.follow(back, now.reference, on_goal=False)
        self._begun, self._stood_s = True, 0.0
        self._first_error = self._least_error = np.abs(now.error)
        self._from_command, self._from_position = now.reference.position.copy(), measured(now)

    def _stop_if_joints_move(self, now: Cycle, known: BoolArray, limp: BoolArray) -> None:
        """Stop all commands if a joint, limp or not, moves further than a blocked joint can.

        A joint that follows its command is free and is not relieved again, unless it then rests closer to its command
        or a neighbor pushes it further. All other joints that still rest before reaching their commands are relieved
        again, because a joint that advances toward its old command may touch the obstacle again. A joint that moves
        further than its command is pushed by a neighbor, so it is still blocked and its motion is measured from its new
        position.
        """
        error, loose = np.abs(now.error), LOOSE * self._sampler.still
        back = self._from_command - now.reference.position
        forth = (measured(now) - self._from_position) * np.sign(self._from_command - self._from_position)
        self._least_error = np.minimum(self._least_error, error)
        returns = (known | limp) & (back != 0.0)
        advances = returns & (forth > loose)
        follows = returns & (-forth > np.maximum(loose, FOLLOWS_SHARE * np.abs(back)))
        pushed = follows & ~limp & (error > self._first_error + loose)
        self._from_command = np.where(pushed, now.reference.position, self._from_command)
        self._from_position = np.where(pushed, measured(now), self._from_position)
        follows &= ~pushed
        if (advances | follows).any():
            self._relieved &= (back == 0.0) | follows | (advances & (self._attempts >= ATTEMPTS))
            most = np.minimum(GROWS * self._first_error, GROWS_AGAIN * self._least_error)
            self._free_error[:, follows] = np.array([SHRINKS * self._first_error, most])[:, follows]
            self._sampler.stop(now.reference, now.parameters)
            self._begun = False


def measured(now: Cycle) -> FloatArray:
    """Return the measured positions (n,). A continuous joint's position is in the same turn as its reference."""
    position: FloatArray = now.reference.position - now.error
    return position
