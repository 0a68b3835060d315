"""Several hardware components as one: what the loop reads and writes."""

import logging
from collections.abc import Callable, Collection, Sequence

import numpy as np

from drivers.bus.counters import BusCounters
from drivers.clock import Clock
from drivers.errors import DriverError
from hal.errors import HalError, PartLost
from hal.lifecycle import Hardware, LifecycleState, Requesting
from hal.member import CONFIGURED, Member, absence, members_of
from hal.types import FloatArray, JointCommand, JointFault, JointState, ServoHealth

LOG = logging.getLogger("servoloop.hal")


class Components:
    """All components in the order of their blocks; joints and commands stand one behind the other.

    Called from the loop's thread. A component that fails in a cycle does not keep the others from theirs: it is
    noted in ``failures``, and left alone until ``drop``.
    """

    def __init__(self, hardware: Sequence[Hardware], clock: Clock, every: Sequence[int] | None = None) -> None:
        self.members = tuple(members_of(hardware, every or [1] * len(hardware)))
        self.joints = tuple(joint for one in hardware for joint in one.joints)
        self.command_interfaces = tuple(name for one in hardware for name in one.command_interfaces)
        self.failures: list[Member] = []
        """Those that failed since somebody looked."""
        self._homes = {joint: member for member in self.members for joint in member.hardware.joints}
        self._clock = clock
        self._cycle = 0
        self._parts: dict[str, JointState] = {}

    @property
    def name(self) -> str:
        """All names."""
        return ", ".join(member.name for member in self.members)

    @property
    def state(self) -> LifecycleState:
        """That of the component which has come furthest."""
        states = {member.hardware.state for member in self.members}
        found = (s for s in (LifecycleState.ACTIVE, LifecycleState.INACTIVE) if s in states)
        return next(found, LifecycleState.UNCONFIGURED)

    @property
    def lost(self) -> list[Member]:
        """Those that have failed, and have not been configured anew."""
        return [member for member in self.members if member.error is not None]

    @property
    def reachable(self) -> bool:
        """Whether a command would reach anybody, as far as is known."""
        active = (m for m in self.members if m.hardware.state is LifecycleState.ACTIVE)
        return any(not (m.away or m.out_of_reach) for m in active)

    def member(self, name: str) -> Member | None:
        """The component of that name."""
        return next((member for member in self.members if member.name == name), None)

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
            for member in self.members:
                if member.name not in leave_out:
                    _tried(member, member.hardware.configure, keep_alive)
        except BaseException:
            self.cleanup()
            raise

    def activate(self, keep_inactive: Collection[str] = (), keep_alive: bool = False) -> None:
        """All that are inactive, but for those named. Raises what the first one raises, with those before it let go.

        ``keep_alive``: such a one stays as it is, and the others go on.
        """
        done: list[Member] = []
        try:
            for member in self.members:
                if member.hardware.state is LifecycleState.INACTIVE and member.name not in keep_inactive:
                    _tried(member, member.hardware.activate, keep_alive)
                    done.append(member)
        except BaseException:
            for member in (member for member in done if member.hardware.state is LifecycleState.ACTIVE):
                for problem in member.hardware.deactivate(relax=True):
                    LOG.error("torque may still be on: %s", problem)
            raise

    def deactivate(self, relax: bool) -> Sequence[str]:
        """All that are active, whatever becomes of the others; returns what went wrong."""
        problems: list[str] = []
        for member in self.members:
            if member.hardware.state is LifecycleState.ACTIVE:
                try:
                    problems += member.hardware.deactivate(relax)
                except Exception as error:  # the next component matters more than this one's failure
                    whom = f" {member.name}" if len(self.members) > 1 else ""
                    problems.append(f"could not switch{whom} off: {error}")
        return problems

    def cleanup(self) -> None:
        """Give everything back, of each; then raises what the first one raised."""
        errors: list[Exception] = []
        for member in self.members:
            try:
                member.hardware.cleanup()
            except Exception as error:  # the others still hold their ports
                errors.append(error)
        if errors:
            raise errors[0]

    def update_every_cycle(self) -> None:
        """From here on each is read and written in every cycle: the end of a motion must reach it."""
        for member in self.members:
            member.every = 1

    def read(self, deadline_s: float | None = None) -> JointState:
        """What is measured now. Of a component that is not there, the last known values and a fault for each joint.

        All components ask before any of them waits, until ``deadline_s`` on the clock if there is one.
        """
        due = [m for m in self.members if m.sound and (self._cycle % m.every == 0 or m.name not in self._parts)]
        self._cycle += 1
        for member in due:
            self._request(member, deadline_s)
        for member in due:
            if member.sound:
                self._read(member)
        only = self.members[0]
        if len(self.members) == 1 and only.sound and only.name in self._parts:
            return self._parts[only.name]
        stamps = [self._parts[m.name].stamp_s for m in due if m.sound]
        return self._merged(max(stamps, default=self._clock.now()))

    def _request(self, member: Member, deadline_s: float | None) -> None:
        if isinstance(member.hardware, Requesting):
            try:
                member.hardware.request(deadline_s)
            except Exception as error:  # as in _read
                self.lose(member, error)

    def _read(self, member: Member) -> None:
        try:
            part = member.hardware.read()
            _check_sizes(part, len(member.hardware.joints))
            self._parts[member.name] = part
        except Exception as error:  # a defect of one component loses this one: the others go on
            self.lose(member, error)

    def _merged(self, stamp_s: float) -> JointState:
        position, velocity, effort = (np.full(len(self.joints), np.nan) for _ in range(3))
        faults: dict[str, JointFault] = {}
        health: dict[str, ServoHealth] = {}
        extra: dict[str, float] = {}
        lines: dict[str, BusCounters] = {}
        for member in self.members:
            part = self._parts.get(member.name)
            if part is not None:
                position[member.joints] = part.position
                velocity[member.joints] = part.velocity
                effort[member.joints] = part.effort
                health |= part.health
                extra |= part.extra
                lines |= part.lines
                faults |= part.faults
            if not member.sound:
                faults |= dict.fromkeys(member.hardware.joints, JointFault("component", absence(member)))
        return JointState(stamp_s, position, velocity, effort, faults, health, extra, lines)

    def write(self, values: FloatArray, period_s: float) -> None:
        """To each that is active its part of ``values`` (m,); a lost one is tried too, it may be lost in part only.

        What takes no commands, a sensor, is only read.
        """
        for member in self.members:
            if member.away:
                continue
            if member.state is not LifecycleState.ACTIVE:
                if member.driven:  # its controllers must not go on as if it followed them
                    self.lose(member, DriverError(f"it has become {member.state.name.lower()} by itself"))
                continue
            member.driven = True
            part = values[member.commands]
            if (self._cycle - 1) % member.every == 0 and part.size and np.isfinite(part).all():
                self._write(member, JointCommand(part, period_s * member.every))

    def _write(self, member: Member, command: JointCommand) -> None:
        member.out_of_reach = False
        try:
            member.hardware.write(command)
        except PartLost as error:
            self.lose(member, error)
        except Exception as error:  # as in read
            member.out_of_reach = True
            self.lose(member, error)

    def lose(self, member: Member, error: Exception) -> None:
        """It is left alone from here on, and noted in ``failures``."""
        if member.error is None:
            defect = None if isinstance(error, DriverError) else error
            LOG.error("%s is lost: %s", member.name, error, exc_info=defect)
            member.error = error
            self.failures.append(member)

    def welcome(self, member: Member) -> None:
        """It is back from its change: what was known of it is old, it is read in the coming cycle."""
        member.away = False
        member.out_of_reach = False
        member.driven = False
        self._parts.pop(member.name, None)
        if member.hardware.state in CONFIGURED:
            member.error = None

    def drop(self, member: Member) -> None:
        """A lost component is given up: what still answers goes on holding, and every port is given back."""
        try:
            member.hardware.cleanup()
        except Exception as error:  # whatever it is, the others go on; this one does not come back
            LOG.error("%s is given up for good: %s", member.name, error)
            member.finalized = True


def _check_sizes(part: JointState, joints: int) -> None:
    sizes = len(part.position), len(part.velocity), len(part.effort)
    if sizes != (joints, joints, joints):
        raise ValueError(f"position, velocity and effort have {sizes} values for {joints} joints")


def _tried(member: Member, step: Callable[[], None], keep_alive: bool) -> None:
    try:
        step()
    except (DriverError, HalError) as error:
        if not keep_alive:
            raise
        LOG.error("%s stays %s: %s", member.name, member.state.name.lower(), error)
