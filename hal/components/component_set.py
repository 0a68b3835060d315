"""A set of hardware components that the control loop reads and writes as one."""

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from drivers.clock import Clock
from drivers.driver_errors import DriverError
from hal.components.component import CONFIGURED, Component, components_of, merged_state
from hal.components.leap_filter import LeapFilter
from hal.hal_errors import HalError, PartLost
from hal.hardware import AskedForTorque, DoubtingLeaps, Hardware, Requesting, outputs_of
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, Interface, JointCommand, JointLimits, JointState

LOG = logging.getLogger("servoloop.hal")


class ComponentSet:
    """All hardware components, in the order of their ``<ros2_control>`` blocks.

    The joints and commands of the set are in the same order. All methods are called from the thread of the control
    loop. A component that fails in a cycle does not affect the others: it is added to ``failures`` and skipped until
    ``drop`` is called.
    """

    def __init__(
        self, hardware: Sequence[Hardware], clock: Clock, cycles_per_update: Sequence[int] | None = None
    ) -> None:
        """Create the set. ``cycles_per_update`` is the number of cycles per update of each component, by default 1."""
        self.components = tuple(components_of(hardware, cycles_per_update or [1] * len(hardware)))
        self.joints = tuple(joint for one in hardware for joint in one.joints)
        self.command_interfaces = tuple(name for one in hardware for name in one.command_interfaces)
        self.failures: list[Component] = []
        """Components that have failed since the list was last cleared."""
        self._requests = {one.name: one.request for one in hardware if isinstance(one, Requesting)}
        """Functions that send a component's request, keyed by component name. They are stored because protocol checks
        are slow.
        """
        self._homes = {joint: component for component in self.components for joint in component.hardware.joints}
        self._outputs = {name: component for component in self.components for name in outputs_of(component.hardware)}
        self._clock = clock
        self._cycle = 0
        self._parts: dict[str, JointState] = {}
        self._filters: dict[str, LeapFilter] = {}

    @property
    def name(self) -> str:
        """Names of all components, separated by commas."""
        return ", ".join(component.name for component in self.components)

    @property
    def state(self) -> LifecycleState:
        """Most advanced life cycle state among the components: active, inactive or unconfigured."""
        states = {component.hardware.state for component in self.components}
        found = (s for s in (LifecycleState.ACTIVE, LifecycleState.INACTIVE) if s in states)
        return next(found, LifecycleState.UNCONFIGURED)

    @property
    def lost(self) -> list[Component]:
        """Components that have failed and have not been configured again."""
        return [component for component in self.components if component.error is not None]

    @property
    def reachable(self) -> bool:
        """Whether a command would probably reach at least one active component."""
        active = (one for one in self.components if one.hardware.state is LifecycleState.ACTIVE)
        return any(not (one.switching or one.out_of_reach) for one in active)

    def component(self, name: str) -> Component | None:
        """Return the component with this name, or None if there is none."""
        return next((component for component in self.components if component.name == name), None)

    def ready(self, interface: str) -> bool:
        """Return whether a controller can use this command interface now: its component must be active and stay so."""
        home = self._outputs.get(interface) or self._homes.get(Interface.parse(interface).joint)
        return home is not None and home.active and not home.leaving

    def measured(self, interface: str) -> bool:
        """Return whether a controller can use this state interface now: its component must be readable."""
        home = self._homes.get(Interface.parse(interface).joint)
        return home is None or home.sound  # a mimic joint has no component; its position follows from its leader

    def update_every_cycle(self) -> None:
        """Update every component in every cycle from now on, so that all components receive the end of a motion."""
        for component in self.components:
            component.cycles_per_update = 1

    def filter_leaps(self, limits: Mapping[str, JointLimits]) -> None:
        """Reject positions that joints with these limits cannot have reached, until a second reading confirms them.

        Components that check their positions themselves are not filtered.
        """
        filtered = [one.hardware for one in self.components if not isinstance(one.hardware, DoubtingLeaps)]
        self._filters = {one.name: LeapFilter(one.name, one.joints, limits) for one in filtered}

    def read(self, deadline_s: float | None = None) -> JointState:
        """Read all components. A component that cannot be read keeps its last known values and gets a fault for each
        joint.

        All components send their requests before any of them waits for replies. The wait ends at the clock time
        ``deadline_s``.
        """
        parts, cycle = self._parts, self._cycle
        self._cycle += 1
        sound = [
            one
            for one in self.components
            if not one.switching and one.error is None and one.hardware.state in CONFIGURED
        ]
        due = [one for one in sound if cycle % one.cycles_per_update == 0 or one.hardware.name not in parts]
        for component in due:
            self._request(component, deadline_s)
        for component in due:
            if component.error is None:
                self._read(component)
        if len(self.components) == len(sound) == 1 and sound[0].error is None:
            return parts[sound[0].hardware.name]
        stamps = [parts[one.hardware.name].stamp_s for one in due if one.error is None]
        return merged_state(self.components, parts, max(stamps, default=self._clock.now()))

    def measure(self, component: Component) -> JointState:
        """Read one component between two cycles, without the jump filter: the caller confirms each position.

        If the component cannot be read, it is marked as lost and the error is raised.
        """
        self._request(component, None)
        if component.error is None:
            self._read(component, confirmed=True)
        if component.error is not None:
            raise component.error
        return self._parts[component.hardware.name]

    def ask_for_torque(self, component: Component) -> frozenset[str]:
        """Check the torque of an active component between two cycles. Return the joints that did not respond.

        If the component cannot be reached, it is marked as lost and the error is raised.
        """
        hardware = component.hardware
        try:
            return hardware.ask_for_torque() if isinstance(hardware, AskedForTorque) else frozenset()
        except Exception as error:  # see _read
            self.lose(component, error)
            raise

    def _request(self, component: Component, deadline_s: float | None) -> None:
        request = self._requests.get(component.hardware.name)
        if request is not None:
            try:
                request(deadline_s)
            except Exception as error:  # see _read
                self.lose(component, error)

    def _read(self, component: Component, confirmed: bool = False) -> None:
        name = component.hardware.name
        try:
            part = component.hardware.read()
            _check_sizes(part, len(component.hardware.joints))
            if name in self._filters:
                believed = self._filters[name].believed(part, component.hardware.state is LifecycleState.ACTIVE)
                part = part if confirmed else believed
            self._parts[name] = part
        except Exception as error:  # an error in one component must not stop the others
            self.lose(component, error)

    def write(self, values: FloatArray, period_s: float) -> None:
        """Write commands of shape (m,) to the active components. Some parts of a lost component may still be
        reachable."""
        for component in self.components:
            if component.switching:
                continue
            if component.finalized or component.hardware.state is not LifecycleState.ACTIVE:
                if component.driven:  # its controllers must not continue as if the component were following them
                    self.lose(component, DriverError(f"it became {component.state.name.lower()} without a request"))
                continue
            component.driven = True
            part = values[component.commands]
            if (self._cycle - 1) % component.cycles_per_update == 0 and component.written and np.isfinite(part).all():
                self._write(component, JointCommand(part, period_s * component.cycles_per_update))

    def _write(self, component: Component, command: JointCommand) -> None:
        component.out_of_reach = False
        try:
            component.hardware.write(command)
        except PartLost as error:
            self.lose(component, error)
        except Exception as error:  # see _read
            component.out_of_reach = True
            self.lose(component, error)

    def lose(self, component: Component, error: Exception) -> None:
        """Mark a component as lost, log the error and add the component to ``failures``."""
        if component.error is None:
            defect = None if isinstance(error, DriverError | HalError) else error
            LOG.error("%s is lost: %s", component.name, error, exc_info=defect)
            component.error = error
            self.failures.append(component)

    def rejoin(self, component: Component) -> None:
        """Return a component to the cycle after a transition, and discard the component's old values."""
        component.switching = False
        component.out_of_reach = False
        component.driven = False
        self._parts.pop(component.name, None)
        if component.name in self._filters:
            self._filters[component.name].forget()
        if component.hardware.state in CONFIGURED:
            component.error = None

    def drop(self, component: Component) -> None:
        """Clean up a lost component and close its ports. Servos that still respond hold their positions."""
        try:
            component.hardware.cleanup()
        except Exception as error:  # the other components must continue
            LOG.error("%s could not be cleaned up and stays unavailable: %s", component.name, error)
            component.finalized = True


def _check_sizes(part: JointState, joints: int) -> None:
    sizes = len(part.position), len(part.velocity), len(part.effort)
    if sizes != (joints, joints, joints):
        raise ValueError(f"position, velocity and effort have {sizes} values for {joints} joints")
