"""The scan: all rates and makes on one port. Only pings and reads; nothing is changed, so nothing is restored.

report = scan(SerialPort("/dev/ttyACM0"), MonotonicClock())
for servo in report.servos:
    print(servo.servo_id, servo.model, servo.voltage_v, *(problem.text for problem in servo.problems))
"""

import contextlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from commissioning.scan.examine import ServoLook, look
from commissioning.scan.problems import Problem
from commissioning.scan.steps import Step, steps
from commissioning.scan.wire import Heard, Wire
from drivers.clock import Clock
from drivers.errors import PortError, PortLost
from drivers.port import Port
from drivers.protocol import v1, v2
from drivers.servos.catalog import Make
from drivers.servos.register import ServoModel

LIKELY_IDS: Final = tuple(range(21))
"""Pinged one by one at each rate as long as nobody was found: not every servo answers a broadcast."""
BROADCASTS: Final = {v1: 2, v2: 1}
"""Of protocol 2.0 one takes a second."""
MORE_BROADCASTS: Final = {v1: 3, v2: 1}
MORE_TRIES: Final = 3
"""Where somebody was heard: on a line that loses packets each question reaches four of five."""

Progress = Callable[[int, int, str, Sequence[ServoLook]], None]
"""Is told the number of the step, how many there are, what it is, and who was found so far."""


@dataclass(frozen=True, slots=True)
class ScanReport:
    """Who is on a line. ``absent``: IDs that were asked for and answer nowhere. ``noise``: bytes of nobody, by rate."""

    port: str
    servos: tuple[ServoLook, ...]
    absent: tuple[int, ...]
    noise: dict[int, int]
    refused_bauds: tuple[int, ...]
    """Rates that the adapter cannot make."""
    skipped: tuple[str, ...]
    """What was not looked for, for servos of another wire protocol had answered."""


def scan(
    port: Port,
    clock: Clock,
    *,
    bauds: Iterable[int] = (),
    servo_ids: Collection[int] = (),
    makes: Collection[Make] = (),
    models: Mapping[int, ServoModel] | None = None,
    progress: Progress = lambda number, count, text, found: None,
) -> ScanReport:
    """Look for servos. With ``servo_ids`` for these alone, one by one; ``bauds``, ``makes``: not all that there are.
    ``models``: which model each ID is to be; those IDs are looked for, if no others are said.

    Without ``makes`` it looks for no other wire protocol once somebody has answered: servos of two cannot share a
    line. The port has its former rate afterwards. Raises PortLost once the line is gone.
    """
    wanted = models or {}
    search = _Search(port, clock, tuple(sorted(servo_ids or wanted)), bool(makes))
    former, todo = port.baud, steps(makes, bauds)
    try:
        for number, step in enumerate(todo):
            progress(number, len(todo), step.text, search.found)
            search.take(step)
        progress(len(todo), len(todo), "done", search.found)
    finally:
        with contextlib.suppress(PortError):  # gone: whoever uses it next is told
            port.set_baud(former)
    return search.report(wanted)


class _Search:
    """What has been found so far, and what is still worth looking for."""

    def __init__(self, port: Port, clock: Clock, servo_ids: Sequence[int], all_makes: bool) -> None:
        self._port, self._clock, self._ids, self._all_makes = port, clock, servo_ids, all_makes
        self.found: list[ServoLook] = []
        self._packets: set[object] = set()
        self._noise: Counter[int] = Counter()
        self._refused: dict[int, None] = {}
        self._skipped: dict[str, None] = {}

    def take(self, step: Step) -> None:
        """Look at one rate with one kind of packets."""
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
        here = [look(self._port, self._clock, step, i) for i in sorted(heard.whole | heard.broken)]
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
        unheard = heard.anything and not heard.whole  # they may all have answered at once
        ids = range(wire.largest_id + 1) if unheard else LIKELY_IDS if not self.found or heard.whole else ()
        return _ping_each(wire, ids, heard)

    def _is_found(self, servo_id: int) -> bool:
        return any(one.servo_id == servo_id for one in self.found)

    def report(self, wanted: Mapping[int, ServoModel]) -> ScanReport:
        """What was found, with what shows only when all are there."""
        absent = tuple(i for i in self._ids if not self._is_found(i))
        servos = tuple(
            _of_the_arm(_compared(one, self.found), wanted) for one in sorted(self.found, key=lambda one: one.servo_id)
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


def _compared(servo: ServoLook, servos: Sequence[ServoLook]) -> ServoLook:
    """With a problem where it is at another rate than most."""
    rates = Counter(one.baud for one in servos)
    usual = max(rates, key=lambda baud: (rates[baud], baud))
    if servo.baud == usual:
        return servo
    twin = next((one for one in servos if one.servo_id == servo.servo_id and one.baud != servo.baud), None)
    also = f", where another servo has ID {servo.servo_id}: give one of them another first" if twin else ""
    text = (
        f"answers at {servo.baud} baud and is silent at the others' {usual}{also}. "
        f"servoloop set-baud {servo.servo_id} {usual} brings it there"
    )
    return replace(servo, problems=(*servo.problems, Problem("other_rate", text)))


def _of_the_arm(servo: ServoLook, wanted: Mapping[int, ServoModel]) -> ServoLook:
    """With a problem where it is of another model than the arm has there."""
    model = wanted.get(servo.servo_id)
    if model is None or servo.model_number in (None, model.number):
        return servo
    text = (
        f"is a {servo.model or 'servo of an unknown model'} (model number {servo.model_number}), and the arm has a "
        f"{model.name} ({model.number}) with ID {servo.servo_id}: put that in, or correct model in the robot file"
    )
    return replace(servo, problems=(*servo.problems, Problem("wrong_model", text)))
