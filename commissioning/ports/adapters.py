"""Serial adapters with all that decides whether servos can be reached through them.

for adapter in ports().adapters:
    print(adapter.device, adapter.chip, *(complaint.text for complaint in adapter.complaints))
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from serial.tools.list_ports_common import ListPortInfo

from commissioning.errors import CommissioningError
from commissioning.ports.chips import CHIPS, chip_text
from commissioning.ports.machine import USUAL_GROUP, Holder, Machine, Permission, permission
from drivers.port.latency import latency_advice

RULE_FILE: Final = "/etc/udev/rules.d/99-servos.rules"
RELOAD: Final = "sudo udevadm control --reload-rules && sudo udevadm trigger"
FTDI_LATENCY: Final = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'


def udev_rule(adapters: Iterable["Adapter"]) -> str:
    """Lines for ``RULE_FILE``: one for each adapter on USB, one for the latency timer of FTDI's."""
    known = [one for one in adapters if one.vid is not None and one.pid is not None]
    lines = dict.fromkeys(_line(one) for one in known)
    drivers = {chip.driver for one in known if (chip := CHIPS.get((one.vid or 0, one.pid or 0)))}
    return "\n".join((*lines, *((FTDI_LATENCY,) if "ftdi_sio" in drivers else ())))


def _line(adapter: "Adapter") -> str:
    matches = [
        'SUBSYSTEM=="tty"',
        f'ATTRS{{idVendor}}=="{adapter.vid:04x}"',
        f'ATTRS{{idProduct}}=="{adapter.pid:04x}"',
    ]
    if adapter.serial_number:
        matches.append(f'ATTRS{{serial}}=="{adapter.serial_number}"')
    return ", ".join((*matches, f'GROUP="{USUAL_GROUP}"', 'MODE="0660"', 'ENV{ID_MM_DEVICE_IGNORE}="1"'))


Kind = Literal["permission", "login", "in_use", "latency", "brltty", "modem_manager", "no_port", "alike"]
Rules = Mapping[str, str]
NO_BRLTTY: Final = "sudo apt-get remove brltty"
NO_MODEM_MANAGER: Final = "sudo systemctl disable --now ModemManager"


@dataclass(frozen=True, slots=True)
class Complaint:
    """``command``: what mends it; None where no command does."""

    kind: Kind
    text: str
    command: str | None = None

    def __str__(self) -> str:
        return f"{self.text}: run '{self.command}'" if self.command else self.text


def adapter_complaints(machine: Machine, rules: Rules, adapter: "Adapter") -> tuple[Complaint, ...]:
    """All that is wrong with one adapter."""
    found = (
        _permission(machine, adapter),
        _in_use(adapter),
        _latency(machine, adapter),
        _brltty(machine, rules, adapter),
        _modem_manager(machine, rules, adapter),
    )
    return tuple(complaint for complaint in found if complaint)


def machine_complaints(machine: Machine, rules: Rules) -> tuple[Complaint, ...]:
    """Adapters that are plugged in and have no port."""
    complaints: list[Complaint] = []
    for numbers, has_port in machine.usb_devices():
        chip = CHIPS.get(numbers)
        if chip is None or has_port:
            continue
        name = f"an adapter ({chip.name}, {_text(numbers)}) is plugged in and has no port"
        if _claims(rules, numbers) or machine.runs("brltty"):
            complaints.append(Complaint("brltty", f"{name}: brltty takes it for a braille display", NO_BRLTTY))
        else:
            complaints.append(
                Complaint("no_port", f"{name}: its kernel driver is not loaded", f"sudo modprobe {chip.driver}")
            )
    return tuple(complaints)


def alike(adapters: Sequence["Adapter"]) -> tuple[Complaint, ...]:
    """Adapters that nothing but their socket tells apart."""
    by_kind: dict[tuple[int | None, int | None], list[str]] = {}
    for one in adapters:
        if one.vid is not None and not one.serial_number:
            by_kind.setdefault((one.vid, one.pid), []).append(one.device)
    return tuple(
        Complaint(
            "alike",
            f"{' and '.join(devices)} are of one kind and have no serial number: their numbers may change places when "
            "they are plugged in again. Use their paths in /dev/serial/by-path",
        )
        for devices in by_kind.values()
        if len(devices) > 1
    )


def _permission(machine: Machine, adapter: "Adapter") -> Complaint | None:
    allowed = adapter.permission
    if allowed is None or allowed.may_open:
        return None
    advice = allowed.advice(machine.user.name)
    if allowed.joined:
        text = f"you are in the group '{allowed.group}' but not yet in this login: log out and in again"
        return Complaint("login", text, advice)
    if allowed.group == "root":
        text = f"only root may open it: paste the udev rule into {RULE_FILE}, join its group, log out and in again"
    else:
        text = f"only the group '{allowed.group}' may open it: join that, then log out and in again"
    return Complaint("permission", text, advice)


def _in_use(adapter: "Adapter") -> Complaint | None:
    if not adapter.holders:
        return None
    who = " and ".join(f"{holder.program} (process {holder.pid})" for holder in adapter.holders)
    return Complaint("in_use", f"it is in use by {who}: end that program first")


def _latency(machine: Machine, adapter: "Adapter") -> Complaint | None:
    if latency_advice(adapter.device, machine.sys_tty) is None:
        return None
    timer = machine.sys_tty / adapter.device.rpartition("/")[2] / "device" / "latency_timer"
    text = f"it holds every reply back for up to {adapter.latency_ms} ms (for good the udev rule helps)"
    return Complaint("latency", text, f"echo 1 | sudo tee {timer}")


def _brltty(machine: Machine, rules: Rules, adapter: "Adapter") -> Complaint | None:
    if not _claims(rules, (adapter.vid, adapter.pid)):
        return None
    running = "is running" if machine.runs("brltty") else "is installed"
    return Complaint("brltty", f"brltty {running} and takes such adapters for braille displays", NO_BRLTTY)


def _modem_manager(machine: Machine, rules: Rules, adapter: "Adapter") -> Complaint | None:
    if adapter.vid is None or not machine.runs("ModemManager") or _ignored(rules, adapter):
        return None
    text = (
        "ModemManager is running and may try a new adapter as a modem, which keeps the port busy for some seconds: "
        f"paste the udev rule into {RULE_FILE} ({RELOAD}), or do without it"
    )
    return Complaint("modem_manager", text, NO_MODEM_MANAGER)


def _claims(rules: Rules, numbers: tuple[int | None, int | None]) -> bool:
    """Whether brltty's rules name this kind of adapter."""
    vid, pid = numbers
    if vid is None or pid is None:
        return False
    return any(f"{vid:x}/{pid:x}" in text for name, text in rules.items() if "brltty" in name)


def _ignored(rules: Rules, adapter: "Adapter") -> bool:
    """Whether a rule tells ModemManager to leave adapters of this vendor alone."""
    lines = (line for text in rules.values() for line in text.splitlines())
    return any("id_mm_device_ignore" in line and f'"{adapter.vid:04x}"' in line for line in lines)


def _text(numbers: tuple[int, int]) -> str:
    return f"{numbers[0]:04x}:{numbers[1]:04x}"


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
