"""The buses of one robot, spoken to by joint: servo IDs repeat from bus to bus, joint names do not."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from operator import attrgetter
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.counters import BusCounters, ServoCounters
from drivers.bus.types import Reading, ServoFault, ServoGoal, ServoState
from drivers.errors import PortError, PortLost, ServoError
from hal.errors import PartLost
from hal.joint import Joint

_LINE_TEXTS: Final = dict.fromkeys(
    ("silent", "late"), "no servo answers on {}: the line, its adapter, the supply of all, or this machine held up"
) | {"no_time": "no servo was measured on {}: the cycle had no time left"}
_counts: Final = attrgetter(*ServoCounters.__slots__)  # to copy; dataclasses.replace takes four times as long


class JointBuses:
    """The buses, opened, as a cycle uses them. Where there are several, every message names the one it is about."""

    def __init__(self, joints: Sequence[Joint], buses: Mapping[str, Bus]) -> None:
        self.buses = dict(buses)
        self.joints_on = {name: [joint for joint in joints if joint.bus == name] for name in buses}
        """By bus."""
        self._joints = tuple(joints)
        self._ids = {name: [joint.servo_id for joint in on] for name, on in self.joints_on.items()}
        # Where each servo is asked by itself the next question depends on the last answer: those first. Meanwhile the
        # bytes of the others gather in the kernel, and a line that is dead takes its whole time last.
        self._in_turn = sorted(buses, key=lambda name: buses[name].read_together)
        self._dead: set[str] = set()

    def label(self, joint: Joint) -> str:
        """The joint's name in a message."""
        return joint.name if len(self.buses) == 1 else f"{joint.name} (bus {joint.bus})"

    def request(self, deadline_s: float) -> None:
        """Ask every servo: the questions are all out before any answer is waited for."""
        for name, bus in self.buses.items():
            with self.named(name):
                bus.request(self._ids[name], deadline_s)

    def receive(self) -> dict[str, Reading]:
        """Wait for every servo's state; returns the states by joint name."""
        readings: dict[str, Mapping[int, Reading]] = {}
        for name in sorted(self._in_turn, key=self._dead.__contains__):
            with self.named(name):
                found = self.buses[name].receive()
            self._dead.discard(name)
            readings[name] = found if all(map(_is_state, found.values())) else self._explained(name, found)
        return self.by_joint(readings)

    def _explained(self, name: str, readings: Mapping[int, Reading]) -> Mapping[int, Reading]:
        """Faults name their joints; where all servos of a line fail in one cycle, the line or the host is named."""
        faults = {i: reading for i, reading in readings.items() if isinstance(reading, ServoFault)}
        kinds = {fault.kind for fault in faults.values()}
        if 1 < len(readings) == len(faults) and kinds <= _LINE_TEXTS.keys():
            self._dead.add(name)
            text = _LINE_TEXTS["no_time" if "no_time" in kinds else "silent"].format(self.buses[name].name)
            return {i: fault._replace(text=text) for i, fault in faults.items()}
        labels = {joint.servo_id: self.label(joint) for joint in self.joints_on[name]}
        return {**readings, **{i: fault._replace(text=f"{labels[i]}: {fault.text}") for i, fault in faults.items()}}

    def by_joint(self, by_bus: Mapping[str, Mapping[int, Reading]]) -> dict[str, Reading]:
        """Readings by joint name, of those by bus and servo ID."""
        return {joint.name: by_bus[joint.bus][joint.servo_id] for joint in self._joints}

    def write_goals(self, goals: Mapping[str, ServoGoal]) -> None:
        """Send one packet a bus, for the joints that have a goal.

        A lost bus does not keep the others from theirs; then it is raised.
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
        """Whether the servos of these joints drive their motors, as far as they answer by a cycle's deadline."""
        states: dict[str, bool] = {}
        for name, bus in self.buses.items():
            asked = {joint.servo_id: joint.name for joint in joints if joint.bus == name}
            if asked:
                with self.named(name):
                    found = bus.torque_states(tuple(asked), deadline_s)
                states |= {asked[i]: driven for i, driven in found.items()}
        return states

    def counters(self) -> dict[str, BusCounters]:
        """The counters of each bus by its name; copies, for another thread."""
        each = ((name, bus.counters) for name, bus in self.buses.items())
        copied = ((n, c, {i: ServoCounters(*_counts(own)) for i, own in c.servos.items()}) for n, c in each)
        return {name: BusCounters(c.noise, c.strange, servos) for name, c, servos in copied}

    def port(self, name: str) -> str:
        """The name of a bus's port."""
        return self.buses[name].name

    def close(self) -> None:
        """Give every port back, whatever the others do."""
        for bus in self.buses.values():
            with suppress(PortError):  # it is gone: there is nothing to give back
                bus.close()

    @contextmanager
    def named(self, name: str) -> Iterator[None]:
        """An error names its bus, if there are several: a lost port with its joints, a servo with its own."""
        try:
            yield
        except PortLost as error:
            if len(self.buses) == 1:
                raise
            out_of_reach = ", ".join(f"{joint.name} (servo {joint.servo_id})" for joint in self.joints_on[name])
            raise PortLost(f"bus {name}: {error}. Out of reach: {out_of_reach}") from error
        except ServoError as error:
            if len(self.buses) == 1:
                raise
            raise type(error)(error.servo_id, f"{error.text} ({self._owner(name, error.servo_id)})") from error

    def _owner(self, name: str, servo_id: int) -> str:
        joint = next(joint for joint in self.joints_on[name] if joint.servo_id == servo_id)
        return f"{joint.name}, bus {name}"


def _is_state(reading: Reading) -> bool:
    return isinstance(reading, ServoState)
