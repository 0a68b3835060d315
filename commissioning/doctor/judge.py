"""The judgement: all checks over one snapshot, ranked."""

from collections.abc import Callable, Iterable, Iterator
from typing import Final

from commissioning.doctor.checks.arm import check_arm
from commissioning.doctor.checks.health import check_health
from commissioning.doctor.checks.identity import check_identity
from commissioning.doctor.checks.line import check_line
from commissioning.doctor.checks.motion import check_motion
from commissioning.doctor.checks.port import check_ports
from commissioning.doctor.checks.presence import check_presence
from commissioning.doctor.checks.protection import check_protection
from commissioning.doctor.checks.settings import check_settings
from commissioning.doctor.checks.voltage import check_voltage
from commissioning.doctor.finding import Finding, ranked
from commissioning.doctor.kinds import KINDS
from commissioning.doctor.snapshot import Snapshot
from commissioning.ports.adapters import PortsReport

CHECKS: Final[tuple[Callable[[Snapshot], Iterable[Finding]], ...]] = (
    check_presence,
    check_line,
    check_identity,
    check_settings,
    check_protection,
    check_voltage,
    check_health,
    check_arm,
    check_motion,
)


def judge(snapshot: Snapshot, ports: PortsReport | None = None) -> tuple[Finding, ...]:
    """All findings, the likeliest root of the others first."""
    return ranked(_all(snapshot, ports), KINDS)


def _all(snapshot: Snapshot, ports: PortsReport | None) -> Iterator[Finding]:
    yield from check_ports(snapshot, ports)
    for check in CHECKS:
        yield from check(snapshot)
