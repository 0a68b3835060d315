"""Minimize with damped least squares and joint limits, from many starting points at once."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hal.types import FloatArray
from planning.kinematics.chain import Chain
from planning.kinematics.goals import PoseGoal

EXACT_M2: Final = 1e-14
"""Sum of squared excess below which a starting point is considered to have reached the goal, in m²."""
DAMPING: Final = 1e-3
"""Initial damping, in m²/rad²."""
DAMPING_RANGE: Final = (1e-9, 1e2)
"""Minimum and maximum damping. If even the maximum damping does not lead to an improvement, the starting point is
considered stuck."""
EASED: Final = 0.2
"""Factor applied to the damping after a step that improves the result."""
STIFFENED: Final = 5.0
"""Factor applied to the damping after a step that does not improve the result."""
LONGEST_STEP: Final = 1.0
"""Maximum motion of a joint in one step, in rad or m."""
PROGRESS: Final = 1e-2
"""Relative decrease of the sum of squares below which a starting point is abandoned as stuck."""


@dataclass(frozen=True, slots=True)
class DescentEffort:
    """Effort limits of a descent."""

    steps: int
    """Maximum number of steps."""
    enough: int
    """Number of successful starting points after which the search stops, once the search from the first starting point
    has ended."""


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Result of a descent from k starting points."""

    positions: FloatArray
    """Joint positions (k, n) within the limits, in rad or m."""
    cost_m2: FloatArray
    """Sums of squared excess (k,), in m²."""


@dataclass(slots=True, eq=False)
class _State:
    """Positions (k, n) with the sums of squared excess (k,), their gradients (k, n) and curvatures (k, n, n)."""

    positions: FloatArray
    cost: FloatArray
    gradient: FloatArray
    curvature: FloatArray

    def of(self, starts: NDArray[np.intp]) -> "_State":
        """Return the state of the given starting points."""
        return _State(self.positions[starts], self.cost[starts], self.gradient[starts], self.curvature[starts])

    def update(self, starts: NDArray[np.intp], new: "_State", better: NDArray[np.bool_]) -> None:
        """Replace the state of those ``starts`` that have improved."""
        replaced = starts[better]
        self.positions[replaced], self.cost[replaced] = new.positions[better], new.cost[better]
        self.gradient[replaced], self.curvature[replaced] = new.gradient[better], new.curvature[better]


def descend(chain: Chain, goal: PoseGoal, starts: FloatArray, share: float, limits: DescentEffort) -> Descent:
    """Move from each starting point to a local minimum of the excess.

    Args:
        chain: Kinematics of the arm.
        goal: Region of poses.
        starts: Joint positions (k, n), in rad or m.
        share: Fraction of the tolerances beyond which the excess begins.
        limits: Limits on the number of steps and of successful starting points.
    """
    state = _evaluate(chain, goal, np.clip(starts, chain.lower, chain.upper), share)
    damping = np.full(len(starts), DAMPING)
    moving = np.flatnonzero(state.cost > EXACT_M2)
    for _ in range(limits.steps):
        if not len(moving) or (moving[0] and np.count_nonzero(state.cost <= EXACT_M2) >= limits.enough):
            break
        at = state.of(moving)
        new = _evaluate(chain, goal, _step(chain, at, damping[moving]), share)
        better = new.cost < at.cost
        stuck = better & (at.cost - new.cost < PROGRESS * at.cost)
        state.update(moving, new, better)
        damping[moving] = np.clip(damping[moving] * np.where(better, EASED, STIFFENED), *DAMPING_RANGE)
        stuck |= damping[moving] >= DAMPING_RANGE[1]
        moving = moving[~stuck & (state.cost[moving] > EXACT_M2)]
    return Descent(state.positions, state.cost)


def _evaluate(chain: Chain, goal: PoseGoal, positions: FloatArray, share: float) -> _State:
    excess, slopes = goal.excess_and_slopes(*chain.transforms_and_jacobians(positions), share)
    turned = slopes.swapaxes(1, 2)
    return _State(positions, (excess**2).sum(axis=1), (turned @ excess[..., None])[..., 0], turned @ slopes)


def _step(chain: Chain, at: _State, damping: FloatArray) -> FloatArray:
    """Return the next joint positions (k, n). Joints that are pushed against a limit are excluded."""
    pressed = (at.positions <= chain.lower) & (at.gradient > 0.0) | (at.positions >= chain.upper) & (at.gradient < 0.0)
    part = np.where(pressed, 0.0, 1.0)
    curvature = at.curvature * (part[:, :, None] * part[:, None, :]) + damping[:, None, None] * np.eye(part.shape[1])
    move = -np.linalg.solve(curvature, (at.gradient * part)[..., None])[..., 0]
    longest = np.abs(move).max(axis=1, keepdims=True)
    move *= np.minimum(1.0, LONGEST_STEP / np.maximum(longest, LONGEST_STEP))
    return np.clip(at.positions + move, chain.lower, chain.upper)
