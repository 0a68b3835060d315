"""Scan a port for servos of all makes at all baud rates. The scan only sends pings and reads.

report = scan(SerialPort("/dev/ttyACM0"), MonotonicClock())
for servo in report.servos:
    print(servo.servo_id, servo.model, servo.voltage_v, *(problem.text for problem in servo.problems))
"""

import contextlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from commissioning.scan.examine import ScannedServo, examine_servo
from commissioning.scan.problems import Problem
from commissioning.scan.steps import ScanStep, steps
from commissioning.scan.wire import Heard, Wire
from drivers.clock import Clock
from drivers.driver_errors import PortError, PortLost
from drivers.port import Port
from drivers.protocol import v1, v2
from drivers.servos.catalog import Make
from drivers.servos.register import ServoModel

LIKELY_IDS: Final = tuple(range(21))
"""IDs that are pinged one by one at each baud rate until a servo is found, because some servos ignore broadcasts."""
BROADCASTS: Final = {v1: 2, v2: 1}
"""Number of broadcast pings, keyed by protocol. A protocol 2.0 broadcast ping takes one second."""
MORE_BROADCASTS: Final = {v1: 3, v2: 1}
"""Number of additional broadcast pings after a reply."""
MORE_TRIES: Final = 3
"""Number of additional pings per ID after a reply, because an unreliable bus may lose one packet in five."""

Progress = Callable[[int, int, str, Sequence[ScannedServo]], None]
"""Progress callback. The arguments are the step number, the number of steps, the description of the step, and the
servos found so far."""


@dataclass(frozen=True, slots=True)
class ScanReport:
    """Result of a scan."""

    port: str
    servos: tuple[ScannedServo, ...]
    absent: tuple[int, ...]
    """Requested IDs that do not respond."""
    noise: dict[int, int]
    """Number of bytes that are not part of a reply, keyed by baud rate."""
    refused_bauds: tuple[int, ...]
    """Baud rates that the adapter does not support."""
    skipped: tuple[str, ...]
    """Types of servos that were not searched for, because servos with another protocol had replied."""

    @property
    def complete(self) -> bool:
        """Whether servos were found, and each requested ID belongs to exactly one servo of the requested model."""
        kinds = {problem.kind for servo in self.servos for problem in servo.problems}
        unique = len({servo.servo_id for servo in self.servos}) == len(self.servos)
        return bool(self.servos) and unique and not self.absent and kinds.isdisjoint(("wrong_model", "collision"))


@dataclass(frozen=True, slots=True)
class ScanScope:
    """Baud rates, IDs and makes that a scan tries."""

    bauds: Collection[int] = ()
    """Baud rates to scan; all if empty."""
    servo_ids: Collection[int] = ()
    """IDs to search for individually; all if empty."""
    makes: Collection[Make] = ()
    """Makes of servos to search for; all if empty."""


EVERYTHING: Final = ScanScope()


def scan(
    port: Port,
    clock: Clock,
    scope: ScanScope = EVERYTHING,
    *,
    models: Mapping[int, ServoModel] | None = None,
    progress: Progress = lambda number, count, text, found: None,
) -> ScanReport:
    """Search a port for servos and examine them.

    The port's original baud rate is restored at the end. If the scope does not specify ``makes``, the scan ignores the
    other protocol after the first reply, because servos with different protocols cannot share a bus.

    Args:
        port: The port.
        clock: Clock for all delays and timeouts.
        scope: Baud rates, IDs and makes to try.
        models: Expected model of each servo, keyed by ID. The scan searches for these IDs if the scope does not specify
            any IDs.
        progress: Function that is called before each step and at the end.

    Raises:
        PortLost: The port has disappeared.
    """
    wanted = models or {}
    search = _Search(port, clock, tuple(sorted(scope.servo_ids or wanted)), bool(scope.makes))
    former, todo = port.baud, steps(scope.makes, scope.bauds)
    try:
        for number, step in enumerate(todo):
            progress(number, len(todo), step.text, search.found)
            search.take(step)
        progress(len(todo), len(todo), "done", search.found)
    finally:
        with contextlib.suppress(PortError):  # If the port has disappeared, its next user gets an error.
            port.set_baud(former)
    return search.report(wanted)


class _Search:
    """State of a scan: the servos found so far, and the IDs and protocols still to search for."""

    def __init__(self, port: Port, clock: Clock, servo_ids: Sequence[int], all_makes: bool) -> None:
        self._port, self._clock, self._ids, self._all_makes = port, clock, servo_ids, all_makes
        self.found: list[ScannedServo] = []
        self._packets: set[object] = set()
        self._noise: Counter[int] = Counter()
        self._refused: dict[int, None] = {}
        self._skipped: dict[str, None] = {}

    def take(self, step: ScanStep) -> None:
        """Scan at one baud rate with one protocol."""
        if self._packets and step.packets not in self._packets and not self._all_makes:
            self._skipped[step.servos] = None
            return
        try:
            self._port.set_baud(step.baud)
        except PortLost:
            raise
        except PortError:
            self._refused[step.baud] = None
            return
        heard = self._listen(Wire(self._port, self._clock, step.packets))
        here = [examine_servo(self._port, self._clock, step, i) for i in sorted(heard.whole | heard.broken)]
        servos = [one for one in here if one is not None]
        self.found += servos
        if servos:
            self._packets.add(step.packets)
        if heard.noise:
            self._noise[step.baud] += heard.noise

    def _listen(self, wire: Wire) -> Heard:
        if self._ids:
            wire.learn_echo()
            missing = [i for i in self._ids if i <= wire.largest_id and not self._is_found(i)]
            return _ping_each(wire, missing, Heard())
        heard = Heard()
        for _ in range(1 if self.found else BROADCASTS[wire.packets]):
            heard |= wire.broadcast()
        for _ in range(MORE_BROADCASTS[wire.packets] if heard.anything else 0):
            heard |= wire.broadcast()
        unheard = heard.anything and not heard.whole  # All servos may have replied at the same time.
        ids = range(wire.largest_id + 1) if unheard else LIKELY_IDS if not self.found or heard.whole else ()
        return _ping_each(wire, ids, heard)

    def _is_found(self, servo_id: int) -> bool:
        return any(one.servo_id == servo_id for one in self.found)

    def report(self, wanted: Mapping[int, ServoModel]) -> ScanReport:
        """Return the report, including problems that become visible only when all servos are known."""
        absent = tuple(i for i in self._ids if not self._is_found(i))
        servos = tuple(
            _of_the_arm(_compared(one, self.found, self._port.name), wanted)
            for one in sorted(self.found, key=lambda one: one.servo_id)
        )
        return ScanReport(
            self._port.name, servos, absent, dict(self._noise), tuple(self._refused), tuple(self._skipped)
        )


def _ping_each(wire: Wire, servo_ids: Iterable[int], heard: Heard) -> Heard:
    for servo_id in servo_ids:
        tries = 1 + MORE_TRIES * heard.anything
        while tries and servo_id not in heard.whole:
            heard |= wire.ping(servo_id)
            tries -= 1
    return heard


def _compared(servo: ScannedServo, servos: Sequence[ScannedServo], port: str) -> ScannedServo:
    """Add a problem to each servo whose baud rate differs from that of most servos."""
    rates = Counter(one.baud for one in servos)
    usual = max(rates, key=lambda baud: (rates[baud], baud))
    if servo.baud == usual:
        return servo
    twin = next((one for one in servos if one.servo_id == servo.servo_id and one.baud != servo.baud), None)
    also = (
        f". Another servo also has ID {servo.servo_id}: first give one of them another ID. Then change the baud rate"
        if twin
        else ". Change its baud rate"
    )
    text = (
        f"it responds at {servo.baud} baud, but most servos respond at {usual} baud{also} with "
        f"servoloop set-baud {servo.servo_id} {usual} --port {port}"
    )
    return replace(servo, problems=(*servo.problems, Problem("other_rate", text)))


def _of_the_arm(servo: ScannedServo, wanted: Mapping[int, ServoModel]) -> ScannedServo:
    """Add a problem to each servo whose model differs from the model in the robot file."""
    model = wanted.get(servo.servo_id)
    if model is None or servo.model_number in (None, model.number):
        return servo
    text = (
        f"its model is {servo.model or 'unknown'} (number {servo.model_number}), but servo {servo.servo_id} of the arm "
        f"must be an {model.name} ({model.number}). Replace the servo, or correct its model in the robot file"
    )
    return replace(servo, problems=(*servo.problems, Problem("wrong_model", text)))
