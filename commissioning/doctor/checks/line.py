"""Check the bus for lost, corrupted and late replies, and for echoes."""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, LineFigures
from drivers.port.latency import HELD_BACK

TOLERATED_SHARE: Final = 0.002
"""Maximum fraction of failed requests. The control loop can repeat a few failed requests without problems."""
TOLERATED_LATE_S: Final = 0.0035
"""Maximum round-trip time in excess of transmission time and return delay. USB adapters buffer bytes for 1 ms in each
direction.
"""


def check_line(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every bus on which requests could be sent."""
    for bus in snapshot.buses:
        if bus.line is not None and bus.line.asked:
            yield from _lossy(bus, bus.line)
            yield from _slow(bus, bus.line)


def _lossy(bus: BusSnapshot, line: LineFigures) -> Iterator[Finding]:
    place, allowed = FindingPlace(bus=bus.name), TOLERATED_SHARE * line.asked
    advice = (
        "Check the plugs of the cables, the ground connection between supply and adapter, and other loads on the supply"
    )
    if line.lost > allowed:
        cause = f"{line.lost} of {line.asked} replies were lost. {advice}"
        yield finding("line_loses", place, "occasional 'there is no status packet'", cause)
    if line.corrupt + line.noise > allowed:
        cause = (
            f"{line.corrupt} of {line.asked} replies were corrupted, and noise was received {line.noise} times between "
            f"replies. {advice}. Use a lower baud rate with long cables"
        )
        yield finding("line_noisy", place, "occasional 'incorrect status packet'", cause)
    if line.late > allowed:
        cause = f"{line.late} of {line.asked} replies arrived after the next request: {HELD_BACK}"
        yield finding("line_late", place, "values are one cycle old, or reads time out", cause, "servoloop ports")


def _slow(bus: BusSnapshot, line: LineFigures) -> Iterator[Finding]:
    place = FindingPlace(bus=bus.name)
    if line.round_trip_s is not None and line.round_trip_s - line.wire_s - line.delay_s > TOLERATED_LATE_S:
        cause = (
            f"A single read takes {1e3 * line.round_trip_s:.1f} ms, but its bytes need only {1e3 * line.wire_s:.2f} "
            f"ms: {HELD_BACK}"
        )
        yield finding(
            "slow_round_trip", place, "the rate of the loop does not exceed a few dozen Hz", cause, "servoloop ports"
        )
    if line.echoes:
        cause = (
            "The adapter echoes every byte that is sent. servoloop handles this, but the programs of the servo "
            "manufacturers do not"
        )
        yield finding("line_echoes", place, "other programs read their own requests as replies", cause)
