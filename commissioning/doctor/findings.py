"""Findings reported by the doctor. A finding has a symptom as users would describe it, a cause, and often a command
that fixes the cause."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

Severity = Literal["fault", "warning", "note"]
SEVERITIES: Final[tuple[Severity, ...]] = ("fault", "warning", "note")


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of finding."""

    severity: Severity
    rank: int
    """Likelihood that a finding of this type is the cause of other findings, from 0 to 100."""
    explains: frozenset[str] = frozenset()
    """Types of findings that are consequences of this type if both are found at the same place."""


@dataclass(frozen=True, slots=True)
class FindingPlace:
    """Place of a finding: the whole machine (all fields are None), a bus, or a servo."""

    bus: str | None = None
    joint: str | None = None
    servo_id: int | None = None

    def covers(self, other: "FindingPlace") -> bool:
        """Return whether the other place is the same as this place or a part of it."""
        return self.bus in (None, other.bus) and self.servo_id in (None, other.servo_id)

    def __str__(self) -> str:
        servo = "" if self.servo_id is None else f"servo {self.servo_id}"
        named = f"{self.joint} ({servo})" if self.joint else servo
        return f"{named} on bus {self.bus}" if named and self.bus else named or (f"bus {self.bus}" if self.bus else "")


@dataclass(frozen=True, slots=True)
class Finding:
    """One problem that was found.

    If no command fixes the problem, ``command`` is None and ``cause`` tells the user what to do.
    """

    id: str
    severity: Severity
    rank: int
    place: FindingPlace
    symptom: str
    cause: str
    command: str | None = None


def ranked(findings: Iterable[Finding], kinds: dict[str, Kind]) -> tuple[Finding, ...]:
    """Return the findings, most likely cause first, without the findings that a more likely finding explains."""
    ordered = sorted(dict.fromkeys(findings), key=_order)
    return tuple(one for at, one in enumerate(ordered) if not any(_explains(kinds, by, one) for by in ordered[:at]))


def _order(finding: Finding) -> tuple[int, int, tuple[str, ...]]:
    """Return a sort key that does not depend on the order of the checks."""
    place = finding.place
    servo = "" if place.servo_id is None else f"{place.servo_id:03d}"
    texts = (place.bus or "", servo, finding.id, str(place), repr(finding))
    return -finding.rank, SEVERITIES.index(finding.severity), texts


def _explains(kinds: dict[str, Kind], by: Finding, one: Finding) -> bool:
    """Return whether the more likely finding explains the other one, so that the other one need not be reported."""
    return by.rank > one.rank and one.id in kinds[by.id].explains and by.place.covers(one.place)


def _kind(severity: Severity, rank: int, *explains: str) -> Kind:
    return Kind(severity, rank, frozenset(explains))


_SILENT: Final = ("servo_absent", "servo_other_rate", "chain_broken", "servo_unsteady", "servo_late", "line_loses")
KINDS: Final[dict[str, Kind]] = {
    # The port.
    "port_taken_by_brltty": _kind("fault", 100, "port_missing", "port_moved", "brltty_present"),
    "port_without_driver": _kind("fault", 99, "port_missing", "port_moved"),
    "port_moved": _kind("fault", 98, "port_missing"),
    "port_missing": _kind("fault", 97),
    "port_denied": _kind("fault", 97),
    "port_busy": _kind("fault", 97),
    "port_not_serial": _kind("fault", 97),
    "port_unsuitable": _kind("fault", 97),
    "port_lost": _kind("fault", 96, "no_power", *_SILENT),
    "latency_timer": _kind("warning", 72, "slow_round_trip", "servo_late", "line_late"),
    "brltty_present": _kind("warning", 40),
    "modem_manager": _kind("warning", 39),
    "adapters_alike": _kind("note", 8),
    # Power and presence.
    "no_power": _kind("fault", 95, *_SILENT),
    "wrong_rate": _kind("fault", 94, "servo_other_rate", "servo_absent", "chain_broken"),
    "chain_broken": _kind("fault", 91, "servo_absent"),
    "same_id": _kind("fault", 90, "servo_unsteady", "line_loses", "line_noisy"),
    "id_not_set": _kind("fault", 89, "servo_absent", "extra_servo"),
    "servo_other_rate": _kind("fault", 88, "servo_absent"),
    "servo_mute": _kind("fault", 87),
    "servo_absent": _kind("fault", 86),
    "wrong_model": _kind("fault", 85, "wrong_mode", "overvoltage", "undervoltage", "servo_unsteady"),
    "servo_late": _kind("warning", 71, "slow_round_trip"),
    "servo_unsteady": _kind("warning", 70),
    "extra_servo": _kind("warning", 45),
    "no_group_reads": _kind("warning", 44),
    # The bus.
    "line_loses": _kind("warning", 69),
    "line_noisy": _kind("warning", 68),
    "line_late": _kind("warning", 67),
    "slow_round_trip": _kind("warning", 48),
    "line_echoes": _kind("note", 4),
    # Model and settings of the servo.
    "wrong_mode": _kind("fault", 84),
    "ids_exchanged": _kind("fault", 83, "homing_offset_differs", "outside_limits"),
    "homing_offset_differs": _kind("fault", 82, "outside_limits"),
    "writes_unacknowledged": _kind("fault", 66),
    "limits_too_narrow": _kind("fault", 62),
    "no_gain": _kind("fault", 61, "gains_differ", "gives_way"),
    "no_torque_allowed": _kind("fault", 60, "gives_way", "does_not_move"),
    "speed_unit": _kind("warning", 46),
    "settings_differ": _kind("warning", 24),
    "lock_open": _kind("warning", 25),
    "protection_off": _kind("warning", 30),
    "wide_dead_zone": _kind("warning", 28, "gives_way"),
    "slow_acceleration": _kind("warning", 27),
    "return_delay": _kind("note", 15),
    "gains_left": _kind("warning", 29, "gives_way"),
    "gains_differ": _kind("note", 10),
    "firmware_differs": _kind("note", 5),
    # Supply voltage, temperature, alarms, torque.
    "overvoltage": _kind("fault", 81, "alarm_voltage", "supply_high"),
    "undervoltage": _kind("fault", 80, "alarm_voltage"),
    "voltage_limits_wrong": _kind("fault", 79, "alarm_voltage"),
    "alarm_voltage": _kind("fault", 78),
    "supply_sags": _kind("warning", 58),
    "supply_high": _kind("warning", 57),
    "supply_low": _kind("warning", 57),
    "voltage_drops": _kind("warning", 56),
    "alarm_overload": _kind("fault", 77, "stalled", "torque_lost"),
    "alarm_current": _kind("fault", 77, "torque_lost"),
    "alarm_temperature": _kind("fault", 76, "hot", "torque_lost"),
    "alarm_other": _kind("fault", 75),
    "was_reset": _kind("fault", 74),
    "torque_lost": _kind("fault", 73),
    "hot": _kind("warning", 55),
    "stalled": _kind("warning", 54),
    "damped": _kind("note", 12),
    # The arm.
    "outside_limits": _kind("fault", 65),
    "turn_counted": _kind("fault", 65),
    "seam_in_range": _kind("fault", 64),
    "travel_differs": _kind("warning", 33),
    "not_calibrated": _kind("note", 20),
    # These findings require that the joints move.
    "motion_failed": _kind("fault", 93),
    "does_not_move": _kind("fault", 59),
    "wrong_gear": _kind("warning", 53),
    "gives_way": _kind("warning", 26),
    "shakes": _kind("warning", 51),
    "not_moved": _kind("note", 3),
}
"""All types of findings, keyed by ID."""


def finding(kind: str, place: FindingPlace, symptom: str, cause: str, command: str | None = None) -> Finding:
    """Return a finding whose type is one of ``KINDS``."""
    return Finding(kind, KINDS[kind].severity, KINDS[kind].rank, place, symptom, cause, command)
