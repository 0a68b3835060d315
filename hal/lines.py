"""The buses of one robot, spoken to by joint: servo IDs repeat from bus to bus, joint names do not."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeVar

from drivers.bus import Reading, ServoBus, ServoFault, ServoGoal
from drivers.counters import ServoCounters
from drivers.diagnose import NOWHERE, diagnose, diagnose_known, now_and_then
from drivers.errors import DriverError, PortError, PortLost, ServoError, ServoRefused
from drivers.tries import ATTEMPTS
from drivers.turns import Steps, overlapped
from hal.errors import PartLost
from hal.joint import Joint

Result = TypeVar("Result")


class Lines:
    """All buses, opened. Where there are several, every message names the one that it is about."""

    def __init__(self, joints: Sequence[Joint], buses: Mapping[str, ServoBus]) -> None:
        self._buses = dict(buses)
        self._joints = tuple(joints)
        self._on = {name: [joint for joint in joints if joint.bus == name] for name in buses}
        self._ids = {name: [joint.servo_id for joint in on] for name, on in self._on.items()}
        self.accounts = {bus.name: bus.counters for bus in buses.values()}
        """What went wrong so far on each, by its port."""

    def label(self, joint: Joint) -> str:
        """What to call a joint in a message."""
        return joint.name if len(self._buses) == 1 else f"{joint.name} (bus {joint.bus})"

    def check(self) -> None:
        """Every servo is there and is what the robot file says; raises with all that are not."""
        problems = [problem for name, bus in self._buses.items() for problem in self._strangers(name, bus)]
        if problems:
            raise DriverError("\n".join(problems))

    def _strangers(self, name: str, bus: ServoBus) -> list[str]:
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

    def _unidentified(self, name: str, bus: ServoBus) -> dict[int, ServoError]:
        errors: dict[int, ServoError] = {}
        for joint in self._on[name]:
            try:
                bus.identify(joint.servo_id, joint.model)
                _refuse_short_reach(joint, bus.position_limits(joint.servo_id))
            except ServoError as error:
                errors[joint.servo_id] = error
        return errors

    def _stateless(self, bus: ServoBus, readings: Mapping[int, Reading]) -> dict[int, str]:
        """The cause for each of those known to be there that gave no state, if one is found."""
        missing = [i for i, reading in readings.items() if isinstance(reading, ServoFault)]
        return diagnose_known(bus, missing) if missing else {}

    def measure(self) -> dict[str, Reading]:
        """Every servo once, without a hurry, by joint name; a fault with its cause, if one is found."""
        readings = []
        for name, bus in self._buses.items():
            with self._named(name):
                found = _states(bus, self._ids[name])
                causes = self._stateless(bus, found)
                readings.append({i: _explained(reading, causes.get(i)) for i, reading in found.items()})
        return self._by_joint(readings)

    def reading(self, deadline_s: float) -> Steps[dict[str, Reading]]:
        """Every servo's state by joint name; the buses' questions are all out before any answer is waited for."""
        readings = yield from overlapped([self._steps(name, deadline_s) for name in self._buses])
        return self._by_joint(readings)

    def _steps(self, name: str, deadline_s: float) -> Steps[Mapping[int, Reading]]:
        with self._named(name):
            return (yield from self._buses[name].state_steps(self._ids[name], deadline_s))

    def _by_joint(self, readings: Sequence[Mapping[int, Reading]]) -> dict[str, Reading]:
        by_bus = dict(zip(self._buses, readings, strict=True))
        return {joint.name: by_bus[joint.bus][joint.servo_id] for joint in self._joints}

    def write_goals(self, goals: Mapping[str, ServoGoal]) -> None:
        """One packet a bus. A lost bus does not keep the others from theirs; then it is raised."""
        lost: list[PortError] = []
        for name, bus in self._buses.items():
            try:
                with self._named(name):
                    bus.write_goals({joint.servo_id: goals[joint.name] for joint in self._on[name]})
            except PortError as error:
                lost.append(error)
        if lost:
            raise lost[0] if len(lost) == len(self._buses) else PartLost(str(lost[0]))

    def goal(self, joint: Joint) -> int:
        """The goal that the servo holds, in counts."""
        return self._ask(joint, lambda bus: bus.goal(joint.servo_id))

    def torque_is_on(self, joint: Joint, deadline_s: float | None = None) -> bool:
        """Whether the servo drives its motor. By a cycle's deadline there is time for one attempt."""
        return self._ask(joint, lambda bus: bus.torque_is_on(joint.servo_id, deadline_s))

    def limit_torque(self, joint: Joint) -> None:
        """To the joint's share of full drive."""
        self._ask(joint, lambda bus: bus.limit_torque(joint.servo_id, joint.torque_limit))

    def torque_on(self, joint: Joint) -> None:
        """Drive the motor."""
        self._ask(joint, lambda bus: bus.torque_on(joint.servo_id))

    def _ask(self, joint: Joint, question: Callable[[ServoBus], Result]) -> Result:
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

    def counters(self, joint: Joint) -> ServoCounters:
        """The joint's account on its bus."""
        return self._buses[joint.bus].counters.of(joint.servo_id)

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


def _states(bus: ServoBus, servo_ids: Sequence[int]) -> dict[int, Reading]:
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


def _explained(reading: Reading, cause: str | None) -> Reading:
    """A fault with its cause for a text, where there is one."""
    return replace(reading, text=cause) if cause and isinstance(reading, ServoFault) else reading
