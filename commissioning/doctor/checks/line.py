"""The line: does it lose, break or delay what goes over it?"""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import BusSnapshot, LineFigures, Snapshot
from drivers.port.latency import HELD_BACK

TOLERATED_SHARE: Final = 0.002
"""Of all questions. The loop asks again, so that a few cost nothing but time."""
TOLERATED_LATE_S: Final = 0.0035
"""Beside wire and return delay: USB adapters gather bytes for a millisecond, each way."""


def check_line(snapshot: Snapshot) -> Iterator[Finding]:
    """All lines over which anything could be asked."""
    for bus in snapshot.buses:
        if bus.line is not None and bus.line.asked:
            yield from _lossy(bus, bus.line)
            yield from _slow(bus, bus.line)


def _lossy(bus: BusSnapshot, line: LineFigures) -> Iterator[Finding]:
    place, allowed = Place(bus=bus.name), TOLERATED_SHARE * line.asked
    where = "check the cable's plugs, the ground between supply and adapter, and what else draws on the supply"
    if line.lost > allowed:
        cause = f"{line.lost} of {line.asked} answers were lost: {where}"
        yield finding("line_loses", place, "'there is no status packet' now and then", cause)
    if line.corrupt + line.noise > allowed:
        cause = (
            f"{line.corrupt} of {line.asked} answers came broken, and {line.noise} times garbage came between them: "
            f"{where}; long cables want a lower baud rate"
        )
        yield finding("line_noisy", place, "'incorrect status packet' now and then", cause)
    if line.late > allowed:
        cause = f"{line.late} of {line.asked} answers came after the next question: {HELD_BACK}"
        yield finding("line_late", place, "values that are a cycle old, reads that time out", cause, "servoloop ports")


def _slow(bus: BusSnapshot, line: LineFigures) -> Iterator[Finding]:
    place = Place(bus=bus.name)
    if line.round_trip_s is not None and line.round_trip_s - line.wire_s - line.delay_s > TOLERATED_LATE_S:
        cause = (
            f"a single read takes {1e3 * line.round_trip_s:.1f} ms, of which its bytes need {1e3 * line.wire_s:.2f}: "
            f"{HELD_BACK}"
        )
        yield finding(
            "slow_round_trip", place, "the loop reaches no more than a few dozen Hz", cause, "servoloop ports"
        )
    if line.echoes:
        cause = "the adapter gives back what is sent: that is understood here, but not by the makers' own programs"
        yield finding("line_echoes", place, "other programs read their own questions as answers", cause)
