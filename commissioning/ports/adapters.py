"""Serial adapters with all that decides whether servos can be reached through them.

for adapter in ports().adapters:
    print(adapter.device, adapter.chip, *(complaint.text for complaint in adapter.complaints))
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

from serial.tools.list_ports_common import ListPortInfo

from commissioning.errors import CommissioningError
from commissioning.ports.chips import chip_text
from commissioning.ports.complaints import Complaint, adapter_complaints, alike, machine_complaints
from commissioning.ports.machine import Holder, Machine
from commissioning.ports.permission import Permission, permission
from commissioning.ports.udev import udev_rule


@dataclass(frozen=True, slots=True)
class Adapter:
    """One serial port. ``vid`` and ``pid`` are None where it does not hang on USB."""

    device: str
    vid: int | None
    pid: int | None
    chip: str
    product: str | None
    serial_number: str | None
    by_id: str | None
    permission: Permission | None
    """None where the device is gone again."""
    latency_ms: int | None
    """How long it gathers bytes; None where it has no such timer."""
    holders: tuple[Holder, ...]
    complaints: tuple[Complaint, ...] = ()


@dataclass(frozen=True, slots=True)
class PortsReport:
    """``complaints``: those that are of no single adapter. ``udev_rule``: a file for the adapters that there are."""

    adapters: tuple[Adapter, ...]
    complaints: tuple[Complaint, ...]
    udev_rule: str


def ports(machine: Machine | None = None) -> PortsReport:
    """Look at all serial adapters. Nothing is opened."""
    machine = machine or Machine()
    found = [_adapter(machine, info) for info in sorted(machine.comports(), key=lambda info: info.device)]
    rules = machine.udev_rules()
    judged = tuple(replace(one, complaints=adapter_complaints(machine, rules, one)) for one in found)
    return PortsReport(judged, machine_complaints(machine, rules) + alike(judged), udev_rule(judged))


def only_port(machine: Machine | None = None) -> str:
    """The device of the only USB adapter. Raises CommissioningError where there is none, or several."""
    report = ports(machine)
    devices = [one.device for one in report.adapters if one.vid is not None]
    if len(devices) == 1:
        return devices[0]
    if devices:
        raise CommissioningError(f"there are {len(devices)} adapters: say which: {', '.join(devices)}")
    others = ", ".join(one.device for one in report.adapters)
    hint = f"plug it in, or name the port ({others})" if others else "plug it in, or name the port"
    why = "".join(f"; {complaint}" for complaint in report.complaints)
    raise CommissioningError(f"no USB adapter is plugged in: {hint}{why}")


def _adapter(machine: Machine, info: ListPortInfo) -> Adapter:
    vid, pid, device = info.vid, info.pid, info.device
    usb = vid is not None and pid is not None
    return Adapter(
        device=device,
        vid=vid if usb else None,
        pid=pid if usb else None,
        chip=chip_text(vid, pid) if usb else "no USB adapter",
        product=info.product,
        serial_number=info.serial_number,
        by_id=machine.by_id(device),
        permission=permission(machine, device),
        latency_ms=_latency_ms(machine.sys_tty / os.path.basename(device) / "device" / "latency_timer"),
        holders=machine.holders(device),
    )


def _latency_ms(timer: Path) -> int | None:
    try:
        return int(timer.read_text())
    except (OSError, ValueError):  # another kind of adapter
        return None
