"""Invariant on the speed scaling of trajectories."""

from collections.abc import Callable
from typing import Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

SLOWEST: Final = 0.04
"""Minimum rate at which the factor approaches the requested factor, as a fraction of the acceleration limit
divided by the velocity limit."""
ROUNDING: Final = 1e-6
"""Tolerance for rounding, in periods or as a factor."""
RECOVERED_S: Final = 1.0
"""Time after a fault of a joint in which the trajectory may wait or resume, in seconds."""


class SpeedScalingIsFollowed(Invariant):
    """The time on a path advances with the speed scaling factor, and the factor approaches the factor that the client
    has requested.

    Cycles are examined only if the factor or the requested factor differs from 1. Late cycles, and cycles soon after a
    fault of one of the arm's joints, are skipped.
    """

    name = "speed scaling is followed"
    promised = False

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        limits = dict(zip(self.commanded, stack.loop.limits, strict=True))
        rates = [limits[joint].acceleration / limits[joint].velocity for joint in arm.joints]
        self._step = SLOWEST * min(rates) * stack.loop.period_s
        """Minimum change of the factor in a cycle."""
        self._before: Tracking | None = None

    def on_state(self, state: JointState) -> None:
        before, self._before = self._before, self.arm.tracking
        now, clients = self._before, self.stack.clients
        if clients is None or now is None or before is None or self.upset:
            return
        if before.path is not now.path or not now.on_goal:
            return
        period_s, asked = self.stack.loop.period_s, clients.speed_factor
        late = abs(now.stamp_s - before.stamp_s - period_s) > ROUNDING
        if late or asked == before.rate == now.rate == 1.0 or self._faulty(state):
            return
        self.examined += 1
        advanced = (now.elapsed_s - before.elapsed_s) / period_s
        if abs(advanced - before.rate) > ROUNDING or now.speed_scaling_factor != now.rate:
            self.say(f"a path advances by {advanced:.3f} periods, but the speed scaling factor is {before.rate:.3f}")
        apart, apart_before = abs(now.rate - asked), abs(before.rate - asked)
        if apart > max(apart_before - self._step, 0.0) + ROUNDING:
            self.say(
                f"the speed scaling factor changes from {before.rate:.4f} to {now.rate:.4f}, but {asked:g} is requested"
            )

    def _faulty(self, state: JointState) -> bool:
        """Return whether a joint of the arm has, or recently had, a fault."""
        touches = self.stack.touches
        return any(one in state.faults or touches.since_s(one) < RECOVERED_S for one in self.arm.joints)
