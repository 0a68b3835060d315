"""Simulated clients, which perform the actions of a schedule between cycles."""

import logging
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

from controller.manager_errors import ManagerError
from controller.motion import MotionError
from drivers.driver_errors import DriverError
from hal.hal_errors import HalError
from hal.types import JointFault, JointState
from servoloop.simulation.acts import (
    Act,
    Grip,
    GuideArm,
    MoveHand,
    ScaleSpeed,
    SocketAct,
)
from servoloop.simulation.grips import GripperClient
from servoloop.simulation.lifecycle_client import PULL_SHARE, LifecycleClient
from servoloop.simulation.stack import SimulatedStack
from servoloop.simulation.trajectory_client import TrajectoryClient

LOG = logging.getLogger("servoloop")


class HandGuidance(Protocol):
    """Interface to the freedrive of a stack."""

    def begin(self) -> None:
        """Let a person move the joints by hand. Raises DriverError."""
        ...

    def end(self) -> None:
        """Make the joints hold their positions."""
        ...

    def update(self, faults: Mapping[str, JointFault], now_s: float) -> None:
        """Update the freedrive after a cycle in which the joints in ``faults`` were not measured."""
        ...


class SocketPrograms(Protocol):
    """Programs that are connected to the command socket of a stack."""

    @property
    def last_target_s(self) -> float:
        """Time of the latest target of a stream, in seconds, or minus infinity before the first stream."""
        ...

    @property
    def owner(self) -> str:
        """Name of the program that has control of the arm, or an empty string if there is no such program."""
        ...

    @property
    def dead_owner(self) -> str:
        """Name of a program that has died but still has control of the arm, or an empty string if there is no such
        program."""
        ...

    def carry_out(self, act: SocketAct) -> None:
        """Perform an action."""
        ...

    def cycle(self) -> None:
        """Continue all programs after a cycle."""
        ...

    def die(self) -> None:
        """Close all connections, as if the programs had been killed."""
        ...


class SimulatedClients:
    """Simulated clients that perform the actions in ``acts`` on an active stack. Call ``cycle`` after each control
    cycle."""

    def __init__(
        self,
        stack: SimulatedStack,
        arm: Any,
        acts: tuple[Act, ...],
        freedrive: HandGuidance,
        programs: SocketPrograms | None = None,
    ) -> None:
        """Connect clients to a stack.

        Args:
            stack: The stack.
            arm: Trajectory controller that receives the goals.
            acts: Actions of the clients.
            freedrive: Freedrive of the stack, for actions that move joints by hand.
            programs: Programs that perform the actions on the command socket; required if ``acts`` contains such
                actions.
        """
        self.programs = programs
        """Programs on the command socket, if there are any."""
        self._stack, self._arm, self._freedrive = stack, arm, freedrive
        self._since_s = stack.clock.now()
        self._trajectories = TrajectoryClient(stack, arm)
        self.lifecycle = LifecycleClient(stack, arm, self._later)
        """Client that switches controllers and activates the hardware again."""
        self._due: list[tuple[float, Callable[[], None]]] = [(act.at_s, self._action(act)) for act in acts]
        self._due.sort(key=lambda one: one[0])
        self._streams: list[Iterator[None]] = []
        self.speed_factor = 1.0
        """Latest speed scaling factor that a client has requested."""
        self.newest = ""
        """Type of the latest action, or empty before the first action."""
        self.gripper = GripperClient(stack) if any(isinstance(act, Grip) for act in acts) else None
        """Client of a gripper action controller, or None if no action needs this client."""

    def cycle(self, state: JointState) -> None:
        """Perform all actions that are due."""
        self._trajectories.measured(state)
        now_s = self._stack.clock.now() - self._since_s
        while self._due and self._due[0][0] <= now_s:
            self._due.pop(0)[1]()
        self._streams = [stream for stream in self._streams if next(stream, self) is not self]
        self._freedrive.update(state.faults, state.stamp_s)
        if self.programs is not None:
            self.programs.cycle()

    def die(self) -> None:
        """Cancel all remaining actions, as if the clients had crashed."""
        self._due.clear()
        self._streams.clear()
        if self.programs is not None:
            self.programs.die()

    def _action(self, act: Act) -> Callable[[], None]:
        trajectories = self._trajectories
        actions: Mapping[str, Callable[[Any], None]] = {
            "move": trajectories.move,
            "plan": trajectories.plan,
            "waypoints": trajectories.waypoints,
            "stream": lambda act: self._streams.append(trajectories.stream(act)),
            "jog": lambda act: self._streams.append(trajectories.jog(act)),
            "cancel": trajectories.cancel,
            "hand": self._hand,
            "grip": self._grip,
            "switch": self.lifecycle.switch,
            "configure": self.lifecycle.configure,
            "reactivate": self.lifecycle.reactivate,
            "scale_speed": self._scale_speed,
            "guide": self._guide,
        }
        programs = self.programs
        if isinstance(act, SocketAct):
            assert programs is not None, "no programs are connected to the command socket"
            actions = {act.kind: programs.carry_out}

        def do() -> None:
            self.newest = act.kind
            try:
                actions[act.kind](act)
            except (DriverError, HalError, ManagerError, MotionError) as error:
                LOG.info("a simulated client's request was rejected: %s", error)

        return do

    def _later(self, after_s: float, action: Callable[[], None]) -> None:
        self._due.append((self._stack.clock.now() - self._since_s + after_s, action))
        self._due.sort(key=lambda one: one[0])

    def _guide(self, act: GuideArm) -> None:
        stack, freedrive = self._stack, self._freedrive
        freedrive.begin()
        joint = next(one for one in stack.files.robot.joints if one.name == act.joint)
        pull = act.share * PULL_SHARE * joint.full_effort
        stack.world.load(act.joint, pull)

        def release() -> None:
            stack.world.load(act.joint, -pull)
            freedrive.end()

        self._later(act.for_s, release)

    def _hand(self, act: MoveHand) -> None:
        limit = self._trajectories.limit_of(self._stack.hand.joints[0])
        self._stack.hand.submit([limit.lower + act.share * (limit.upper - limit.lower)])

    def _grip(self, act: Grip) -> None:
        assert self.gripper is not None, "no controller was added for this action"
        goal, gripper = self.gripper.grip(act), self.gripper
        if goal is not None and act.cancel_after_s > 0.0:
            self._later(act.cancel_after_s, lambda: gripper.cancel(goal))

    def _scale_speed(self, act: ScaleSpeed) -> None:
        self._arm.scaling.ask(act.factor)
        self.speed_factor = act.factor
