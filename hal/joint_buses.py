"""The buses of one robot, spoken to by joint: servo IDs repeat from bus to bus, joint names do not."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Final, TypeVar

from drivers.bus.bus import Bus
from drivers.bus.counters import BusCounters
from drivers.bus.diagnose import NOWHERE, diagnose, diagnose_known, now_and_then
from drivers.bus.retry import ATTEMPTS
from drivers.bus.types import Reading, ServoFault, ServoGoal, ServoState
from drivers.errors import DriverError, PortError, PortLost, ServoError, ServoRefused
from hal.errors import PartLost
from hal.joint import Joint

Result = TypeVar("Result")

_LINE_TEXTS: Final = dict.fromkeys(
    ("silent", "late"), "no servo answers on {}: the line, its adapter, the supply of all, or this machine held up"
) | {"no_time": "no servo was measured on {}: the cycle had no time left"}


class JointBuses:
    """All buses, opened. Where there are several, every message names the one that it is about."""

    def __init__(self, joints: Sequence[Joint], buses: Mapping[str, Bus]) -> None:
        self._buses = dict(buses)
        self._joints = tuple(joints)
        self._on = {name: [joint for joint in joints if joint.bus == name] for name in buses}
        self._ids = {name: [joint.servo_id for joint in on] for name, on in self._on.items()}
        # Where each servo is asked by itself the next question depends on the last answer: those first. Meanwhile the
        # bytes of the others gather in the kernel, and a line that is dead takes its whole time last.
        self._in_turn = sorted(buses, key=lambda name: buses[name].read_together)
        self._dead: set[str] = set()

    def label(self, joint: Joint) -> str:
        """What to call a joint in a message."""
        return joint.name if len(self._buses) == 1 else f"{joint.name} (bus {joint.bus})"

    def check(self) -> None:
        """Every servo is there and is what the robot file says; raises with all that are not."""
        problems = [problem for name, bus in self._buses.items() for problem in self._strangers(name, bus)]
        if problems:
            raise DriverError("\n".join(problems))

    def _strangers(self, name: str, bus: Bus) -> list[str]:
        with self._named(name):
            errors = self._unidentified(name, bus)
            unheard = [i for i, error in errors.items() if not isinstance(error, ServoRefused)]
            causes = diagnose(bus, unheard) if unheard else {}
            # Two of one model and one ID have the same number: only their states give them away.
            known = [i for i in self._ids[name] if i not in errors]
            causes |= self._stateless(bus, _states(bus, known)) if known else {}
        if len(causes) == len(self._on[name]) and all(NOWHERE in text for text in causes.values()):
            which = f" (bus {name})" if len(self._buses) > 1 else ""
            return [f"no servo answers on {bus.name}{which} at any baud rate: check the servos' power and their IDs"]
        labels = {joint.servo_id: self.label(joint) for joint in self._on[name]}
        problems = {i: now_and_then(i) if i in unheard else str(error) for i, error in errors.items()} | causes
        return [f"{labels[i]}: {problems[i]}" for i in self._ids[name] if i in problems]

    def _unidentified(self, name: str, bus: Bus) -> dict[int, ServoError]:
        errors: dict[int, ServoError] = {}
        for joint in self._on[name]:
            try:
                bus.identify(joint.servo_id, joint.model)
                _refuse_short_reach(joint, bus.position_limits(joint.servo_id))
            except ServoError as error:
                errors[joint.servo_id] = error
        return errors

    def _stateless(self, bus: Bus, readings: Mapping[int, Reading]) -> dict[int, str]:
        """The cause for each of those known to be there that gave no state, if one is found."""
        missing = [i for i, reading in readings.items() if isinstance(reading, ServoFault)]
        return diagnose_known(bus, missing) if missing else {}

    def measure(self) -> dict[str, Reading]:
        """Every servo once, without a hurry, by joint name; a fault with its cause, if one is found."""
        readings: dict[str, Mapping[int, Reading]] = {}
        for name, bus in self._buses.items():
            with self._named(name):
                found = _states(bus, self._ids[name])
                causes = self._stateless(bus, found)
                readings[name] = {i: _with_cause(reading, causes.get(i)) for i, reading in found.items()}
        return self._by_joint(readings)

    def request(self, deadline_s: float) -> None:
        """Ask every servo: the questions are all out before any answer is waited for."""
        for name, bus in self._buses.items():
            with self._named(name):
                bus.request(self._ids[name], deadline_s)

    def receive(self) -> dict[str, Reading]:
        """Every servo's state by joint name."""
        readings: dict[str, Mapping[int, Reading]] = {}
        for name in sorted(self._in_turn, key=self._dead.__contains__):
            with self._named(name):
                found = self._buses[name].receive()
            self._dead.discard(name)
            readings[name] = found if all(map(_is_state, found.values())) else self._explained(name, found)
        return self._by_joint(readings)

    def _explained(self, name: str, readings: Mapping[int, Reading]) -> Mapping[int, Reading]:
        """Faults name their joints; where all servos of a line fail in one cycle, the line or the host is named."""
        faults = {i: reading for i, reading in readings.items() if isinstance(reading, ServoFault)}
        kinds = {fault.kind for fault in faults.values()}
        if 1 < len(readings) == len(faults) and kinds <= _LINE_TEXTS.keys():
            self._dead.add(name)
            text = _LINE_TEXTS["no_time" if "no_time" in kinds else "silent"].format(self._buses[name].name)
            return {i: fault._replace(text=text) for i, fault in faults.items()}
        labels = {joint.servo_id: self.label(joint) for joint in self._on[name]}
        return {**readings, **{i: fault._replace(text=f"{labels[i]}: {fault.text}") for i, fault in faults.items()}}

    def _by_joint(self, by_bus: Mapping[str, Mapping[int, Reading]]) -> dict[str, Reading]:
        return {joint.name: by_bus[joint.bus][joint.servo_id] for joint in self._joints}

    def write_goals(self, goals: Mapping[str, ServoGoal]) -> None:
        """One packet a bus, for the joints that have a goal.

        A lost bus does not keep the others from theirs; then it is raised.
        """
        lost: list[PortError] = []
        for name, bus in self._buses.items():
            try:
                with self._named(name):
                    bus.write_goals({j.servo_id: goals[j.name] for j in self._on[name] if j.name in goals})
            except PortError as error:
                lost.append(error)
        if lost:
            raise lost[0] if len(lost) == len(self._buses) else PartLost(str(lost[0]))

    def goal(self, joint: Joint) -> int:
        """The goal that the servo holds, in counts."""
        return self._ask(joint, lambda bus: bus.goal(joint.servo_id))

    def torque_is_on(self, joint: Joint) -> bool:
        """Whether the servo drives its motor."""
        return self._ask(joint, lambda bus: bus.torque_is_on(joint.servo_id))

    def torque_states(self, joints: Sequence[Joint], deadline_s: float) -> dict[str, bool]:
        """Whether the servos of these joints drive their motors, as far as they answer by a cycle's deadline."""
        states: dict[str, bool] = {}
        for name, bus in self._buses.items():
            asked = {joint.servo_id: joint.name for joint in joints if joint.bus == name}
            if asked:
                with self._named(name):
                    found = bus.torque_states(tuple(asked), deadline_s)
                states |= {asked[i]: driven for i, driven in found.items()}
        return states

    def limit_torque(self, joint: Joint) -> None:
        """To the joint's share of full drive."""
        self._ask(joint, lambda bus: bus.limit_torque(joint.servo_id, joint.torque_limit))

    def torque_on(self, joint: Joint) -> None:
        """Drive the motor."""
        self._ask(joint, lambda bus: bus.torque_on(joint.servo_id))

    def _ask(self, joint: Joint, question: Callable[[Bus], Result]) -> Result:
        with self._named(joint.bus):
            return question(self._buses[joint.bus])

    def torque_off(self, joints: Sequence[Joint]) -> list[str]:
        """Let go, on every bus whatever becomes of the others; returns what failed."""
        problems: list[str] = []
        for name, bus in self._buses.items():
            ids = [joint.servo_id for joint in joints if joint.bus == name]
            try:
                with self._named(name):
                    problems += [self._said(name, error) for error in bus.torque_off(ids)] if ids else []
            except PortError as error:
                problems.append(str(error))
        return problems

    def _said(self, name: str, error: ServoError) -> str:
        if len(self._buses) == 1:
            return str(error)
        joint = next(joint for joint in self._on[name] if joint.servo_id == error.servo_id)
        return f"{self.label(joint)}: {error}"

    def counters(self) -> dict[str, BusCounters]:
        """What went wrong so far on each bus, by its name; copies, for another thread."""
        return {name: bus.counters.copy() for name, bus in self._buses.items()}

    def port(self, name: str) -> str:
        """The name of a bus's port."""
        return self._buses[name].name

    def close(self) -> None:
        """Give every port back, whatever the others do."""
        for bus in self._buses.values():
            try:
                bus.close()
            except PortError:
                continue  # it is gone: there is nothing to give back

    @contextmanager
    def _named(self, name: str) -> Iterator[None]:
        """Of several buses, the one that failed is named: a lost port with its joints, a servo with its own."""
        try:
            yield
        except PortLost as error:
            if len(self._buses) == 1:
                raise
            out_of_reach = ", ".join(f"{joint.name} (servo {joint.servo_id})" for joint in self._on[name])
            raise PortLost(f"bus {name}: {error}. Out of reach: {out_of_reach}") from error
        except ServoError as error:
            if len(self._buses) == 1:
                raise
            raise type(error)(error.servo_id, f"{error.text} ({self._owner(name, error.servo_id)})") from error

    def _owner(self, name: str, servo_id: int) -> str:
        joint = next(joint for joint in self._on[name] if joint.servo_id == servo_id)
        return f"{joint.name}, bus {name}"


def _is_state(reading: Reading) -> bool:
    return isinstance(reading, ServoState)


def _states(bus: Bus, servo_ids: Sequence[int]) -> dict[int, Reading]:
    """Without a hurry; whoever gave none is asked again."""
    found: dict[int, Reading] = {}
    missing = list(servo_ids)
    for _ in range(ATTEMPTS):
        found |= bus.read_states(missing)
        missing = [i for i, reading in found.items() if isinstance(reading, ServoFault)]
        if not missing:
            break
    return found


def _refuse_short_reach(joint: Joint, limits: tuple[int, int] | None) -> None:
    """Beyond its own limits a servo does not go, and does not tell: some stop there, others forget the goal."""
    if limits is None:
        return
    last = joint.model.last_count
    lowest, highest = (min(max(counts, 0), last) for counts in joint.counts_range())
    if limits[0] <= lowest and highest <= limits[1]:
        return
    raise ServoRefused(
        joint.servo_id,
        f"has position limits of its own, {limits[0]} to {limits[1]} counts, and its joint goes from {lowest} to "
        f"{highest}: widen them in the servo, or {_advice(joint, max(limits[0], lowest), min(limits[1], highest))}",
    )


def _advice(joint: Joint, lowest: int, highest: int) -> str:
    """What the joint's limits may be, in joint units to six digits, rounded inwards."""
    if lowest >= highest:
        return "correct zero_counts: the two hardly overlap"
    lower, upper = sorted(joint.position(counts) for counts in (lowest, highest))
    return (
        f"narrow the joint's in the URDF to {math.ceil(lower * 1e6) / 1e6:.6f} to {math.floor(upper * 1e6) / 1e6:.6f}"
    )


def _with_cause(reading: Reading, cause: str | None) -> Reading:
    """A fault with its cause for a text, where there is one."""
    return reading._replace(text=cause) if cause and isinstance(reading, ServoFault) else reading
