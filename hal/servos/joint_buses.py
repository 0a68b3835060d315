"""The buses of one component, addressed by joint name, because different buses may use the same servo IDs."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from operator import attrgetter
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.counters import BusCounters, ServoCounters
from drivers.driver_errors import DriverError, PortError, PortLost, ServoError
from drivers.types import Reading, ServoFault, ServoGoal, ServoState
from hal.hal_errors import PartLost
from hal.joint import Joint

_LINE_TEXTS: Final = {  # The first kind of fault that occurred is reported.
    "no_time": "no servo was measured on {}: the cycle had no time left",
    "late": "all servos on {} respond too late: check the adapter and the load of this computer",
    "silent": "no servo responds on {}: check the cable, adapter, supply and load of this computer",
}
_counts: Final = attrgetter(*ServoCounters.__slots__)  # copies four times as fast as dataclasses.replace


class JointBuses:
    """Open buses of one component. If there are several buses, every message contains the name of the bus."""

    def __init__(self, joints: Sequence[Joint], buses: Mapping[str, Bus]) -> None:
        self.buses = dict(buses)
        self.joints_on = {name: [joint for joint in joints if joint.bus == name] for name in buses}
        """Joints on each bus, keyed by bus name."""
        self._joints = tuple(joints)
        self.several = len({joint.bus for joint in joints}) > 1
        """Whether the joints use several buses, even if only one of them is open."""
        self._ids = {name: [joint.servo_id for joint in on] for name, on in self.joints_on.items()}
        # Buses that read servos one by one come first: while they wait for each reply, the kernel buffers the bytes of
        # the other buses. Dead buses are read last, because they use up all remaining time.
        self._in_turn = sorted(buses, key=lambda name: buses[name].read_together)
        self._dead: set[str] = set()

    def label(self, joint: Joint) -> str:
        """Return the name of a joint for use in messages, including its bus if there are several."""
        return joint.name if not self.several else f"{joint.name} (bus {joint.bus})"

    def request(self, deadline_s: float) -> None:
        """Send the requests to all servos before waiting for any reply."""
        for name, bus in self.buses.items():
            with self.named(name):
                bus.request(self._ids[name], deadline_s)

    def receive(self) -> dict[str, Reading]:
        """Wait for the states of all servos. Return the readings, keyed by joint name."""
        readings: dict[str, Mapping[int, Reading]] = {}
        for name in sorted(self._in_turn, key=self._dead.__contains__):
            with self.named(name):
                found = self.buses[name].receive()
            self._dead.discard(name)
            readings[name] = found if all(map(_is_state, found.values())) else self._explained(name, found)
        return self.by_joint(readings)

    def _explained(self, name: str, readings: Mapping[int, Reading]) -> Mapping[int, Reading]:
        """Add the name of the joint to each fault.

        If all servos of a bus fail in one cycle, describe the bus instead.
        """
        faults = {i: reading for i, reading in readings.items() if isinstance(reading, ServoFault)}
        kinds = {fault.kind for fault in faults.values()}
        if 1 < len(readings) == len(faults) and kinds <= _LINE_TEXTS.keys():
            self._dead.add(name)
            text = next(text for kind, text in _LINE_TEXTS.items() if kind in kinds).format(self.buses[name].name)
            return {i: fault._replace(text=text) for i, fault in faults.items()}
        labels = {joint.servo_id: self.label(joint) for joint in self.joints_on[name]}
        return {**readings, **{i: fault._replace(text=f"{labels[i]}: {fault.text}") for i, fault in faults.items()}}

    def by_joint(self, by_bus: Mapping[str, Mapping[int, Reading]]) -> dict[str, Reading]:
        """Convert readings keyed by bus and servo ID to readings keyed by joint name."""
        return {joint.name: by_bus[joint.bus][joint.servo_id] for joint in self._joints}

    def write_goals(self, goals: Mapping[str, ServoGoal]) -> None:
        """Send one packet on each bus, containing the goals of its joints. A lost bus does not affect the others.

        Raises:
            PartLost: Some of the buses are lost.
            PortError: All buses are lost.
        """
        lost: list[PortError] = []
        for name, bus in self.buses.items():
            try:
                with self.named(name):
                    bus.write_goals({j.servo_id: goals[j.name] for j in self.joints_on[name] if j.name in goals})
            except PortError as error:
                lost.append(error)
        if lost:
            raise lost[0] if len(lost) == len(self.buses) else PartLost(str(lost[0]))

    def torque_states(self, joints: Sequence[Joint], deadline_s: float) -> dict[str, bool]:
        """Return whether torque is enabled, keyed by joint name. Servos that did not reply in time are omitted."""
        states: dict[str, bool] = {}
        for name, bus in self.buses.items():
            asked = {joint.servo_id: joint.name for joint in joints if joint.bus == name}
            if asked:
                with self.named(name):
                    found = bus.torque_states(tuple(asked), deadline_s)
                states |= {asked[i]: driven for i, driven in found.items()}
        return states

    def counters(self) -> dict[str, BusCounters]:
        """Return copies of each bus's counters, keyed by bus name. Another thread may use the copies."""
        each = ((name, bus.counters) for name, bus in self.buses.items())
        copied = ((n, c, {i: ServoCounters(*_counts(own)) for i, own in c.servos.items()}) for n, c in each)
        return {name: BusCounters(c.noise, c.strange, servos) for name, c, servos in copied}

    def port(self, name: str) -> str:
        """Return the port of a bus."""
        return self.buses[name].name

    def close(self) -> None:
        """Close all ports, even if some of them fail."""
        for bus in self.buses.values():
            with suppress(PortError):  # the port is already lost
                bus.close()

    @contextmanager
    def named(self, name: str) -> Iterator[None]:
        """If there are several buses, add the bus and its joints to an error message."""
        try:
            yield
        except (PortLost, ServoError) as error:
            if not self.several:
                raise
            named: DriverError
            if isinstance(error, ServoError):
                named = type(error)(error.servo_id, f"{error.text} ({self._owner(name, error.servo_id)})")
            else:
                out_of_reach = ", ".join(f"{joint.name} (servo {joint.servo_id})" for joint in self.joints_on[name])
                named = PortLost(f"bus {name}: {error}. Out of reach: {out_of_reach}")
            named.__notes__ = getattr(error, "__notes__", [])
            raise named from error

    def _owner(self, name: str, servo_id: int) -> str:
        return next(f"{joint.name}, bus {name}" for joint in self.joints_on[name] if joint.servo_id == servo_id)


def _is_state(reading: Reading) -> bool:
    return isinstance(reading, ServoState)
