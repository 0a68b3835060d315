"""The port: is it there, may we open it, who else has it, and does it hold bytes back?"""

from collections.abc import Iterator
from pathlib import PurePath
from typing import Final

from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import BusSnapshot, PortProblem, Snapshot
from commissioning.ports.adapters import Adapter, Complaint, PortsReport

UNPLUGGED: Final = "the adapter's port is not there"
SYMPTOMS: Final[dict[PortProblem, tuple[str, str]]] = {
    "missing": ("port_missing", UNPLUGGED),
    "denied": ("port_denied", "permission denied on the port"),
    "busy": ("port_busy", "the port is busy"),
    "not_serial": ("port_not_serial", "the port is not a serial device"),
    "unsuitable": ("port_unsuitable", "the port does not take the bus's baud rate"),
    "lost": ("port_lost", "the port vanished while the servos were asked"),
}
COMPLAINTS: Final = {
    "latency": ("latency_timer", "each read takes 16 ms or so: the loop is slow or late"),
    "brltty": ("brltty_present", "the port may vanish soon after it was plugged in"),
    "modem_manager": ("modem_manager", "the port is busy for some seconds after it was plugged in"),
}
"""What an adapter may suffer from although it can be opened."""


def check_ports(snapshot: Snapshot, report: PortsReport | None) -> Iterator[Finding]:
    """``report``: what is known of the machine's adapters; None where nothing is."""
    adapters = report.adapters if report else ()
    for bus in snapshot.buses:
        place = Place(bus=bus.name)
        own = [one for one in adapters if bus.port in (one.device, one.by_id)]
        if bus.problem:
            yield _not_open(bus, bus.problem, own)
        if bus.problem == "missing":
            yield from _gone(bus, place, report)
        for adapter in own:
            yield from (_complaint(place, one) for one in adapter.complaints if one.kind in COMPLAINTS)
    for complaint in report.complaints if report else ():
        if complaint.kind == "alike":
            text = "after a replug the ports may have changed places"
            yield finding("adapters_alike", Place(), text, complaint.text, complaint.command)


def _not_open(bus: BusSnapshot, problem: PortProblem, own: list[Adapter]) -> Finding:
    kind, symptom = SYMPTOMS[problem]
    commands = {one.command for adapter in own for one in adapter.complaints if one.kind in ("permission", "login")}
    command = next(iter(commands), None) if problem == "denied" else None
    return finding(kind, Place(bus=bus.name), f"{bus.port}: {symptom}", bus.problem_text, command)


def _gone(bus: BusSnapshot, place: Place, report: PortsReport | None) -> Iterator[Finding]:
    """Where the port may be instead, or what has taken it."""
    if report is None:
        return
    for complaint in report.complaints:
        kind = {"brltty": "port_taken_by_brltty", "no_port": "port_without_driver"}.get(complaint.kind)
        if kind:
            symptom = f"{bus.port}: the port vanishes at once, or never appears"
            yield finding(kind, place, symptom, complaint.text, complaint.command)
    others = [one for one in report.adapters if one.vid is not None]
    if len(others) == 1:
        lasting = others[0].by_id or others[0].device
        cause = (
            f"the only adapter is {others[0].device} ({others[0].chip}, serial number {others[0].serial_number}): "
            f"numbers of ports change with each replug, {PurePath(lasting).name} does not"
        )
        command = f"servoloop doctor --port {lasting}"
        yield finding("port_moved", place, f"{bus.port}: {UNPLUGGED} any more", cause, command)


def _complaint(place: Place, complaint: Complaint) -> Finding:
    kind, symptom = COMPLAINTS[complaint.kind]
    return finding(kind, place, symptom, complaint.text, complaint.command)
