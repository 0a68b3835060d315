"""Hardware component for serial bus servos. Real and virtual servos differ only below the port."""

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

from drivers.clock import Clock
from hal.joint import Joint
from hal.lifecycle import LifecycleState, require, require_configured
from hal.servos.activation import Activation
from hal.servos.gravity_compensation import GravityCompensation
from hal.servos.joint_buses import JointBuses
from hal.servos.open_buses import OpenBuses, open_all, open_reachable
from hal.servos.servo_goals import ServoGoals
from hal.servos.servo_outputs import ServoOutputs
from hal.servos.servo_setup import ServoSetup
from hal.servos.servo_states import ServoStates
from hal.servos.soft_torque import SoftTorque
from hal.types import JointCommand, JointState, position_interfaces

READ_SHARE = 0.5
"""Maximum duration of a read without a deadline, as a fraction of the loop period."""
FIRST_PERIOD_S = 0.05
"""Assumed period before the first command."""


class ServoHardware:
    """Hardware component (see ``hal.hardware.Hardware``) with servos on one or several buses."""

    def __init__(
        self,
        name: str,
        joints: Sequence[Joint],
        open_buses: OpenBuses,
        clock: Clock,
        compensation: GravityCompensation | None = None,
        outputs: ServoOutputs | None = None,
    ) -> None:
        """Create the component. With a function for each bus, torque can be disabled even if another bus is missing."""
        self.name = name
        self.joints = tuple(joint.name for joint in joints)
        self.command_interfaces = position_interfaces(joint.name for joint in joints)
        self.state = LifecycleState.UNCONFIGURED
        self.doubts_leaps = True
        self._joints = tuple(joints)
        self._open_buses = open_buses
        self._buses: JointBuses | None = None
        self._activation: Activation | None = None
        self._clock = clock
        self.compensation = compensation
        self.outputs = outputs.names if outputs else ()
        self._outputs = outputs if outputs and (outputs.names or outputs.has_inputs) else None
        self._period_s = FIRST_PERIOD_S
        self._goals = ServoGoals(joints)
        self.soft_torque = SoftTorque(joints, lambda: ServoSetup(self._opened("limit the torque")), compensation)
        self._states = ServoStates(joints, clock)
        self._states.stalls = self._goals.stalls
        self._requested = self._measured = False
        self._deadline_s = math.inf

    def configure(self) -> None:
        require(self.state, LifecycleState.UNCONFIGURED, "configure")
        self._buses = open_all(self._joints, self._open_buses)
        self.state = LifecycleState.INACTIVE
        self._states.reset()
        try:
            self._check(ServoSetup(self._buses))
            self.read()
        except BaseException:
            self.cleanup()
            raise

    def _check(self, setup: ServoSetup) -> None:
        """Check the servos when the component is configured. Raises DriverError."""
        setup.check()

    def activate(self) -> None:
        """Enable torque after setting every goal to the measured position (see ``Activation``)."""
        require(self.state, LifecycleState.INACTIVE, "activate")
        buses = self._opened("activate")
        self._states.faults.forget()
        states = self._states
        self._activation = activation = Activation(
            self._joints, buses, self._clock, lambda readings: states.update(readings, buses), states.reset
        )
        held = activation.run()
        try:
            self._goals.hold(held)
            if self.compensation is not None:
                self.compensation.restart()
            if self._outputs is not None:
                self._outputs.forget()
            self.state = LifecycleState.ACTIVE
            self.read()
        except BaseException:  # a bus is lost; no other code would disable the torque
            self.state = LifecycleState.INACTIVE
            activation.release()
            raise

    @property
    def torque_left(self) -> tuple[str, ...]:
        """Errors of servos whose torque may still be enabled after the last activation has failed."""
        return () if self._activation is None else self._activation.torque_left

    def holds(self) -> bool:
        """Return whether torque is enabled for any servo of the configured component. Raises DriverError."""
        return any(map(ServoSetup(self._opened("check the torque")).torque_is_on, self._joints))

    def disable_torque(self) -> Sequence[str]:
        """Disable the torque of all servos that respond, even if the component could not be configured."""
        if self._buses:
            return ServoSetup(self._buses).torque_off(self._joints)
        buses, errors = open_reachable(self._joints, self._open_buses)
        with closing(buses):
            return [*map(str, errors), *ServoSetup(buses).torque_off(self._joints)]

    def undo_activation(self) -> Sequence[str]:
        """Undo the activation.

        Servos whose torque was already enabled continue to hold their positions, because otherwise the arm would fall.
        """
        require(self.state, LifecycleState.ACTIVE, "undo the activation")
        assert self._activation is not None
        self.state = LifecycleState.INACTIVE
        self._goals.forget_stalls()
        return self._activation.undo()

    @property
    def without_torque(self) -> frozenset[str]:
        return self._states.faults.named if self.state is LifecycleState.ACTIVE else frozenset()

    def ask_for_torque(self) -> frozenset[str]:
        """Check the torque of every servo now. Return the joints whose servos did not respond."""
        require(self.state, LifecycleState.ACTIVE, "check the torque")
        return self._states.faults.ask_all(self._opened("check the torque"))

    def reactivate(self) -> frozenset[str]:
        """Enable the torque of limp joints at their measured positions. The other servos continue to hold their
        positions."""
        require(self.state, LifecycleState.ACTIVE, "reactivate")
        names = self.without_torque
        joints = [joint for joint in self._joints if joint.name in names]
        # The measurements do not update the states, because only a completed activation ends a fault.
        held = Activation(joints, self._opened("reactivate"), self._clock, lambda readings: None).run()
        self._goals.hold(held)
        self._states.reactivated(names)
        if self.compensation is not None:
            self.compensation.restart(names)
        if self._outputs is not None:
            self._outputs.forget()
        return names

    def deactivate(self, relax: bool) -> Sequence[str]:
        require(self.state, LifecycleState.ACTIVE, "deactivate")
        self.state = LifecycleState.INACTIVE
        self._goals.forget_stalls()
        if not relax:
            self.soft_torque.restore()
        return ServoSetup(self._opened("deactivate")).torque_off(self._joints, self._open_buses) if relax else []

    def cleanup(self) -> None:
        self.state = LifecycleState.UNCONFIGURED
        if self._buses is not None:
            self._buses.close()
            self._buses = None

    def request(self, deadline_s: float | None = None) -> None:
        """Request the states of all servos on all buses."""
        buses = self._opened("read")
        self._deadline_s = self._clock.now() + READ_SHARE * self._period_s if deadline_s is None else deadline_s
        buses.request(self._deadline_s)
        self._requested = True

    def read(self) -> JointState:
        """Read the replies of the servos until the deadline. A silent servo keeps its last known values and gets a
        fault."""
        if not self._requested:
            self.request()
        self._requested = False
        buses = self._opened("read")
        ask_until_s = self._deadline_s if self.state is LifecycleState.ACTIVE else None
        state = self._states.update(buses.receive(), buses, ask_until_s)
        self._measured = True
        if self._outputs is not None:
            self._outputs.read(buses, self._clock.now(), self._deadline_s)
            return replace(state, extra=self._outputs.values)
        return state

    def write(self, command: JointCommand) -> None:
        """Send the goals of all servos, using one packet per bus.

        The command has passed the safety gate. A servo that may be limp receives no goal, because a goal would enable
        its torque.
        """
        require(self.state, LifecycleState.ACTIVE, "write")
        self._period_s = command.period_s
        wanted = command.values if self.compensation is None else command.values + self.compensation.offsets
        # The goals are stored before they are sent, because servos on other buses receive them even if one bus is lost.
        measured = self._states.measured if self._measured else {}
        self._measured = False  # a component that has lost a bus is not read in the next cycle
        withheld = self._states.faults.withheld
        goals = self._goals.towards(wanted.tolist(), command.period_s, measured, self._states.loads, withheld)
        try:
            self._opened("write").write_goals(goals)
            if self._outputs is not None:
                self._outputs.send(self._opened("write"))
        finally:
            if self.compensation is not None:
                self.compensation.update(command, self._states)  # for the next command

    def _opened(self, action: str) -> JointBuses:
        require_configured(self.state, action)
        assert self._buses is not None
        return self._buses
