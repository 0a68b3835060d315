"""Several hardware components as one: what the loop reads and writes."""

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from drivers.clock import Clock
from drivers.errors import DriverError
from hal.components.component import CONFIGURED, Component, components_of, merged_state
from hal.components.leap_filter import LeapFilter
from hal.errors import PartLost
from hal.hardware import AskedForTorque, DoubtingLeaps, Hardware, Requesting
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointCommand, JointLimits, JointState

LOG = logging.getLogger("servoloop.hal")


class ComponentSet:
    """The set has all components in the order of their blocks; joints and commands stand one behind the other.

    Called from the loop's thread. A component that fails in a cycle does not keep the others from theirs: it is
    noted in ``failures``, and left alone until ``drop``.
    """

    def __init__(
        self, hardware: Sequence[Hardware], clock: Clock, cycles_per_update: Sequence[int] | None = None
    ) -> None:
        """``cycles_per_update`` of each component; unless said, all are read and written in every cycle."""
        self.components = tuple(components_of(hardware, cycles_per_update or [1] * len(hardware)))
        self.joints = tuple(joint for one in hardware for joint in one.joints)
        self.command_interfaces = tuple(name for one in hardware for name in one.command_interfaces)
        self.failures: list[Component] = []
        """Components that have failed since somebody looked."""
        self._homes = {joint: component for component in self.components for joint in component.hardware.joints}
        self._clock = clock
        self._cycle = 0
        self._parts: dict[str, JointState] = {}
        self._filters: dict[str, LeapFilter] = {}

    @property
    def name(self) -> str:
        """The names of all components."""
        return ", ".join(component.name for component in self.components)

    @property
    def state(self) -> LifecycleState:
        """The state of the component that has come furthest."""
        states = {component.hardware.state for component in self.components}
        found = (s for s in (LifecycleState.ACTIVE, LifecycleState.INACTIVE) if s in states)
        return next(found, LifecycleState.UNCONFIGURED)

    @property
    def lost(self) -> list[Component]:
        """Components that have failed, and have not been configured anew."""
        return [component for component in self.components if component.error is not None]

    @property
    def reachable(self) -> bool:
        """Whether a command would reach anybody, as far as is known."""
        active = (one for one in self.components if one.hardware.state is LifecycleState.ACTIVE)
        return any(not (one.switching or one.out_of_reach) for one in active)

    def component(self, name: str) -> Component | None:
        """The component of that name."""
        return next((component for component in self.components if component.name == name), None)

    def ready(self, interface: str) -> bool:
        """Whether a controller can use this command interface now: it needs an active component."""
        home = self._homes.get(interface.rpartition("/")[0])
        return home is not None and home.active

    def measured(self, interface: str) -> bool:
        """Whether a controller can use this state interface now: it needs a sound component."""
        home = self._homes.get(interface.rpartition("/")[0])
        return home is None or home.sound  # a joint that mimics is wherever its leader is

    def update_every_cycle(self) -> None:
        """From here on each component is read and written in every cycle: the end of a motion must reach it."""
        for component in self.components:
            component.cycles_per_update = 1

    def doubt_leaps(self, limits: Mapping[str, JointLimits]) -> None:
        """Believe a position that its joint cannot have reached only if a second reading confirms it.

        ``limits`` by joint. Components that doubt leaps by themselves are left alone.
        """
        doubted = [one.hardware for one in self.components if not isinstance(one.hardware, DoubtingLeaps)]
        self._filters = {one.name: LeapFilter(one.name, one.joints, limits) for one in doubted}

    def read(self, deadline_s: float | None = None) -> JointState:
        """Read all components; one that is not there has its last known values, and a fault for each joint.

        All components ask before any of them waits, until ``deadline_s`` on the clock if there is one.
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
        """Read one component between two cycles, for a caller that confirms each position by itself.

        Raises what keeps the component from being read; it is lost then.
        """
        self._request(component, None)
        if component.error is None:
            self._read(component, confirmed=True)
        if component.error is not None:
            raise component.error
        return self._parts[component.hardware.name]

    def ask_for_torque(self, component: Component) -> frozenset[str]:
        """Ask an active component's joints whether they have torque, between two cycles.

        Returns the joints that gave no answer. Raises what keeps the component from being asked; it is lost then.
        """
        hardware = component.hardware
        try:
            return hardware.ask_for_torque() if isinstance(hardware, AskedForTorque) else frozenset()
        except Exception as error:  # as in _read
            self.lose(component, error)
            raise

    def _request(self, component: Component, deadline_s: float | None) -> None:
        if isinstance(component.hardware, Requesting):
            try:
                component.hardware.request(deadline_s)
            except Exception as error:  # as in _read
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
        except Exception as error:  # a defect of one component loses this one: the others go on
            self.lose(component, error)

    def write(self, values: FloatArray, period_s: float) -> None:
        """Write its part of ``values`` (m,) to each active component; one may be lost in part only, and is tried too.

        What takes no commands, a sensor, is only read.
        """
        for component in self.components:
            if component.switching:
                continue
            if component.finalized or component.hardware.state is not LifecycleState.ACTIVE:
                if component.driven:  # its controllers must not go on as if it followed them
                    self.lose(component, DriverError(f"it has become {component.state.name.lower()} by itself"))
                continue
            component.driven = True
            part = values[component.commands]
            if (self._cycle - 1) % component.cycles_per_update == 0 and part.size and np.isfinite(part).all():
                self._write(component, JointCommand(part, period_s * component.cycles_per_update))

    def _write(self, component: Component, command: JointCommand) -> None:
        component.out_of_reach = False
        try:
            component.hardware.write(command)
        except PartLost as error:
            self.lose(component, error)
        except Exception as error:  # as in read
            component.out_of_reach = True
            self.lose(component, error)

    def lose(self, component: Component, error: Exception) -> None:
        """A failed component is left alone from here on, and noted in ``failures``."""
        if component.error is None:
            defect = None if isinstance(error, DriverError) else error
            LOG.error("%s is lost: %s", component.name, error, exc_info=defect)
            component.error = error
            self.failures.append(component)

    def rejoin(self, component: Component) -> None:
        """A component is back from its transition: its last values are old, it is read in the coming cycle."""
        component.switching = False
        component.out_of_reach = False
        component.driven = False
        self._parts.pop(component.name, None)
        if component.name in self._filters:
            self._filters[component.name].forget()
        if component.hardware.state in CONFIGURED:
            component.error = None

    def drop(self, component: Component) -> None:
        """A lost component is given up: what still answers goes on holding, and every port is given back."""
        try:
            component.hardware.cleanup()
        except Exception as error:  # whatever it is, the others go on; this one does not come back
            LOG.error("%s is given up for good: %s", component.name, error)
            component.finalized = True


def _check_sizes(part: JointState, joints: int) -> None:
    sizes = len(part.position), len(part.velocity), len(part.effort)
    if sizes != (joints, joints, joints):
        raise ValueError(f"position, velocity and effort have {sizes} values for {joints} joints")
