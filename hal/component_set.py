"""Several hardware components as one: what the loop reads and writes."""

import logging
from collections.abc import Callable, Collection, Sequence

import numpy as np

from drivers.bus.counters import BusCounters
from drivers.clock import Clock
from drivers.errors import DriverError
from hal.component import CONFIGURED, Component, absence, components_of
from hal.errors import HalError, PartLost
from hal.lifecycle import Hardware, LifecycleState, Requesting
from hal.types import FloatArray, JointCommand, JointFault, JointState, ServoHealth

LOG = logging.getLogger("servoloop.hal")


class ComponentSet:
    """All components in the order of their blocks; joints and commands stand one behind the other.

    Called from the loop's thread. A component that fails in a cycle does not keep the others from theirs: it is
    noted in ``failures``, and left alone until ``drop``.
    """

    def __init__(
        self, hardware: Sequence[Hardware], clock: Clock, cycles_per_update: Sequence[int] | None = None
    ) -> None:
        self.components = tuple(components_of(hardware, cycles_per_update or [1] * len(hardware)))
        self.joints = tuple(joint for one in hardware for joint in one.joints)
        self.command_interfaces = tuple(name for one in hardware for name in one.command_interfaces)
        self.failures: list[Component] = []
        """Those that failed since somebody looked."""
        self._homes = {joint: component for component in self.components for joint in component.hardware.joints}
        self._clock = clock
        self._cycle = 0
        self._parts: dict[str, JointState] = {}

    @property
    def name(self) -> str:
        """All names."""
        return ", ".join(component.name for component in self.components)

    @property
    def state(self) -> LifecycleState:
        """That of the component which has come furthest."""
        states = {component.hardware.state for component in self.components}
        found = (s for s in (LifecycleState.ACTIVE, LifecycleState.INACTIVE) if s in states)
        return next(found, LifecycleState.UNCONFIGURED)

    @property
    def lost(self) -> list[Component]:
        """Those that have failed, and have not been configured anew."""
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

    def configure(self, leave_out: Collection[str] = (), keep_alive: bool = False) -> None:
        """All but those named. Raises what the first one raises, with those before it given back.

        ``keep_alive``: such a one stays as it is, and the others go on.
        """
        try:
            for component in self.components:
                if component.name not in leave_out:
                    _tried(component, component.hardware.configure, keep_alive)
        except BaseException:
            self.cleanup()
            raise

    def activate(self, keep_inactive: Collection[str] = (), keep_alive: bool = False) -> None:
        """All that are inactive, but for those named. Raises what the first one raises, with those before it let go.

        ``keep_alive``: such a one stays as it is, and the others go on.
        """
        done: list[Component] = []
        try:
            for component in self.components:
                if component.hardware.state is LifecycleState.INACTIVE and component.name not in keep_inactive:
                    _tried(component, component.hardware.activate, keep_alive)
                    done.append(component)
        except BaseException:
            for component in (component for component in done if component.hardware.state is LifecycleState.ACTIVE):
                for problem in component.hardware.deactivate(relax=True):
                    LOG.error("torque may still be on: %s", problem)
            raise

    def deactivate(self, relax: bool) -> Sequence[str]:
        """All that are active, whatever becomes of the others; returns what went wrong."""
        problems: list[str] = []
        for component in self.components:
            if component.hardware.state is LifecycleState.ACTIVE:
                try:
                    problems += component.hardware.deactivate(relax)
                except Exception as error:  # the next component matters more than this one's failure
                    whom = f" {component.name}" if len(self.components) > 1 else ""
                    problems.append(f"could not switch{whom} off: {error}")
        return problems

    def cleanup(self) -> None:
        """Give everything back, of each; then raises what the first one raised."""
        errors: list[Exception] = []
        for component in self.components:
            try:
                component.hardware.cleanup()
            except Exception as error:  # the others still hold their ports
                errors.append(error)
        if errors:
            raise errors[0]

    def update_every_cycle(self) -> None:
        """From here on each is read and written in every cycle: the end of a motion must reach it."""
        for component in self.components:
            component.cycles_per_update = 1

    def read(self, deadline_s: float | None = None) -> JointState:
        """What is measured now. Of a component that is not there, the last known values and a fault for each joint.

        All components ask before any of them waits, until ``deadline_s`` on the clock if there is one.
        """
        due = [
            m
            for m in self.components
            if m.sound and (self._cycle % m.cycles_per_update == 0 or m.name not in self._parts)
        ]
        self._cycle += 1
        for component in due:
            self._request(component, deadline_s)
        for component in due:
            if component.sound:
                self._read(component)
        only = self.components[0]
        if len(self.components) == 1 and only.sound and only.name in self._parts:
            return self._parts[only.name]
        stamps = [self._parts[one.name].stamp_s for one in due if one.sound]
        return self._merged(max(stamps, default=self._clock.now()))

    def _request(self, component: Component, deadline_s: float | None) -> None:
        if isinstance(component.hardware, Requesting):
            try:
                component.hardware.request(deadline_s)
            except Exception as error:  # as in _read
                self.lose(component, error)

    def _read(self, component: Component) -> None:
        try:
            part = component.hardware.read()
            _check_sizes(part, len(component.hardware.joints))
            self._parts[component.name] = part
        except Exception as error:  # a defect of one component loses this one: the others go on
            self.lose(component, error)

    def _merged(self, stamp_s: float) -> JointState:
        position, velocity, effort = (np.full(len(self.joints), np.nan) for _ in range(3))
        faults: dict[str, JointFault] = {}
        health: dict[str, ServoHealth] = {}
        extra: dict[str, float] = {}
        lines: dict[str, BusCounters] = {}
        for component in self.components:
            part = self._parts.get(component.name)
            if part is not None:
                position[component.joints] = part.position
                velocity[component.joints] = part.velocity
                effort[component.joints] = part.effort
                health |= part.health
                extra |= part.extra
                lines |= part.lines
                faults |= part.faults
            if not component.sound:
                faults |= dict.fromkeys(component.hardware.joints, JointFault("component", absence(component)))
        return JointState(stamp_s, position, velocity, effort, faults, health, extra, lines)

    def write(self, values: FloatArray, period_s: float) -> None:
        """To each that is active its part of ``values`` (m,); a lost one is tried too, it may be lost in part only.

        What takes no commands, a sensor, is only read.
        """
        for component in self.components:
            if component.switching:
                continue
            if component.state is not LifecycleState.ACTIVE:
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
        """It is left alone from here on, and noted in ``failures``."""
        if component.error is None:
            defect = None if isinstance(error, DriverError) else error
            LOG.error("%s is lost: %s", component.name, error, exc_info=defect)
            component.error = error
            self.failures.append(component)

    def rejoin(self, component: Component) -> None:
        """It is back from its change: what was known of it is old, it is read in the coming cycle."""
        component.switching = False
        component.out_of_reach = False
        component.driven = False
        self._parts.pop(component.name, None)
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


def _tried(component: Component, step: Callable[[], None], keep_alive: bool) -> None:
    try:
        step()
    except (DriverError, HalError) as error:
        if not keep_alive:
            raise
        LOG.error("%s stays %s: %s", component.name, component.state.name.lower(), error)
