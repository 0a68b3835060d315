"""Check the ports: missing, denied, busy or moved ports, and adapters that delay replies."""

from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Final

from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, PortProblem
from commissioning.ports.adapters import Adapter, Complaint, PortsReport
from drivers.paths import resolved

UNPLUGGED: Final = "the adapter's port does not exist"
SYMPTOMS: Final[dict[PortProblem, tuple[str, str]]] = {
    "missing": ("port_missing", UNPLUGGED),
    "denied": ("port_denied", "permission denied on the port"),
    "busy": ("port_busy", "the port is busy"),
    "not_serial": ("port_not_serial", "the port is not a serial device"),
    "unsuitable": ("port_unsuitable", "the port does not support the baud rate of the bus"),
    "lost": ("port_lost", "the port disappeared during the examination"),
}
COMPLAINTS: Final = {
    "latency": ("latency_timer", "each read takes about 16 ms, so the loop is slow or late"),
    "brltty": ("brltty_present", "the port may disappear soon after the adapter is plugged in"),
    "modem_manager": ("modem_manager", "the port is busy for a few seconds after the adapter is plugged in"),
}
"""Adapter problems with which the port can still be opened."""


def check_ports(snapshot: ArmSnapshot, report: PortsReport | None) -> Iterator[Finding]:
    """Check the port of every bus; ``report`` describes the machine's adapters, or is None if they are unknown."""
    adapters = report.adapters if report else ()
    for bus in snapshot.buses:
        place = FindingPlace(bus=bus.name)
        own = [one for one in adapters if resolved(bus.port) in _places(one)]
        if bus.problem:
            yield _not_open(bus, bus.problem, own)
        if bus.problem == "missing":
            yield from _gone(bus, place, snapshot, report)
        for adapter in own:
            yield from (_complaint(place, one) for one in adapter.complaints if one.kind in COMPLAINTS)
    for complaint in report.complaints if report else ():
        if complaint.kind == "alike":
            text = "the names of two ports may be swapped after the adapters are plugged in again"
            yield finding("adapters_alike", FindingPlace(), text, _sentence(complaint.text), complaint.command)


def _not_open(bus: BusSnapshot, problem: PortProblem, own: list[Adapter]) -> Finding:
    kind, symptom = SYMPTOMS[problem]
    commands = {one.command for adapter in own for one in adapter.complaints if one.kind in ("permission", "login")}
    command = next(iter(commands), None) if problem == "denied" else None
    return finding(kind, FindingPlace(bus=bus.name), f"{bus.port}: {symptom}", bus.problem_text, command)


def _gone(
    bus: BusSnapshot, place: FindingPlace, snapshot: ArmSnapshot, report: PortsReport | None
) -> Iterator[Finding]:
    """Find the new name of a missing port, or the program that is using the port."""
    if report is None:
        return
    for complaint in report.complaints:
        kind = {"brltty": "port_taken_by_brltty", "no_port": "port_without_driver"}.get(complaint.kind)
        if kind:
            symptom = f"{bus.port}: the port disappears at once or never appears"
            yield finding(kind, place, symptom, _sentence(complaint.text), complaint.command)
    used = {resolved(one.port) for one in snapshot.buses}
    others = [one for one in report.adapters if one.vid is not None and used.isdisjoint(_places(one))]
    if len(others) == 1:
        lasting = others[0].by_id or others[0].device
        options = (one.port_option(lasting if one is bus else "") for one in snapshot.buses)
        command = f"servoloop doctor --arm {snapshot.arm} {' '.join(options)}"
        yield finding("port_moved", place, f"{bus.port}: {UNPLUGGED} anymore", _moved_to(others[0]), command)


def _places(adapter: Adapter) -> set[Path]:
    """Return the paths to which the names of an adapter lead. A bus may be opened through any link to the device."""
    return {resolved(name) for name in (adapter.device, adapter.by_id) if name}


def _moved_to(adapter: Adapter) -> str:
    serial = f", serial number {adapter.serial_number}" if adapter.serial_number else ""
    text = f"The only other adapter is at {adapter.device} ({adapter.chip}{serial})"
    if adapter.by_id is None:
        return text
    name = PurePath(adapter.by_id).name
    return f"{text}. The number of a port can change whenever the adapter is plugged in; {name} does not change"


def _complaint(place: FindingPlace, complaint: Complaint) -> Finding:
    kind, symptom = COMPLAINTS[complaint.kind]
    return finding(kind, place, symptom, _sentence(complaint.text), complaint.command)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
