"""List the machine's serial adapters with all problems that prevent or slow down access to the servos.

for adapter in ports().adapters:
    print(adapter.device, adapter.chip, *(complaint.text for complaint in adapter.complaints))
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from serial.tools.list_ports_common import ListPortInfo

from commissioning.commissioning_errors import CommissioningError
from commissioning.ports.chips import CHIPS, chip_text
from commissioning.ports.machine import USUAL_GROUP, Holder, Machine, PortPermission, permission
from drivers.port.latency import latency_advice

RULE_FILE: Final = "/etc/udev/rules.d/99-servos.rules"
RELOAD: Final = "sudo udevadm control --reload-rules && sudo udevadm trigger"
FTDI_LATENCY: Final = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'


def udev_rule(adapters: Iterable["Adapter"]) -> str:
    """Return the lines for ``RULE_FILE``: one per USB adapter, and one for the latency timer of FTDI adapters."""
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
    """A problem with an adapter."""

    kind: Kind
    text: str
    command: str | None = None
    """Command that fixes the problem; None if no such command exists."""

    def __str__(self) -> str:
        return f"{self.text}: run '{self.command}'" if self.command else self.text


def adapter_complaints(machine: Machine, rules: Rules, adapter: "Adapter") -> tuple[Complaint, ...]:
    """Return all problems with one adapter."""
    found = (
        _permission(machine, adapter),
        _in_use(adapter),
        _latency(machine, adapter),
        _brltty(machine, rules, adapter),
        _modem_manager(machine, rules, adapter),
    )
    return tuple(complaint for complaint in found if complaint)


def machine_complaints(machine: Machine, rules: Rules) -> tuple[Complaint, ...]:
    """Return the problems of adapters that are plugged in but have no port."""
    complaints: list[Complaint] = []
    for numbers, has_port in machine.usb_devices():
        chip = CHIPS.get(numbers)
        if chip is None or has_port:
            continue
        name = f"an adapter ({chip.name}, {_text(numbers)}) is plugged in but has no port"
        if _claims(rules, numbers) or machine.runs("brltty"):
            text = f"{name}, because the program brltty mistakes it for a braille display. Remove brltty"
            complaints.append(Complaint("brltty", text, NO_BRLTTY))
        else:
            text = f"{name}, because its kernel driver is not loaded. Load the driver"
            complaints.append(Complaint("no_port", text, f"sudo modprobe {chip.driver}"))
    return tuple(complaints)


def alike(adapters: Sequence["Adapter"]) -> tuple[Complaint, ...]:
    """Return a problem for each group of adapters that differ only in their USB socket."""
    by_kind: dict[tuple[int | None, int | None], list[str]] = {}
    for one in adapters:
        if one.vid is not None and not one.serial_number:
            by_kind.setdefault((one.vid, one.pid), []).append(one.device)
    return tuple(
        Complaint(
            "alike",
            f"{' and '.join(devices)} have the same USB IDs and no serial number, so their names may be swapped when "
            "they are plugged in again. Use their paths in /dev/serial/by-path instead",
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
        text = (
            f"you have joined the group '{allowed.group}', but the change takes effect only at the next login: log out "
            "and in again"
        )
        return Complaint("login", text, advice)
    if allowed.group == "root":
        text = (
            f"only root may open the port: paste the udev rule into {RULE_FILE}, join the group '{USUAL_GROUP}', then "
            "log out and in again"
        )
    else:
        text = (
            f"only members of the group '{allowed.group}' may open the port: join the group, then log out and in again"
        )
    return Complaint("permission", text, advice)


def _in_use(adapter: "Adapter") -> Complaint | None:
    if not adapter.holders:
        return None
    who = " and ".join(f"{holder.program} (process {holder.pid})" for holder in adapter.holders)
    return Complaint("in_use", f"the port is in use by {who}: end that program first")


def _latency(machine: Machine, adapter: "Adapter") -> Complaint | None:
    if latency_advice(adapter.device, machine.sys_tty) is None:
        return None
    timer = machine.sys_tty / adapter.device.rpartition("/")[2] / "device" / "latency_timer"
    text = (
        f"the adapter delays every reply by up to {adapter.latency_ms} ms. The command fixes this until the adapter is "
        "unplugged; the udev rule fixes it permanently"
    )
    return Complaint("latency", text, f"echo 1 | sudo tee {timer}")


def _brltty(machine: Machine, rules: Rules, adapter: "Adapter") -> Complaint | None:
    if not _claims(rules, (adapter.vid, adapter.pid)):
        return None
    running = "is running" if machine.runs("brltty") else "is installed"
    text = f"the program brltty {running} and may mistake this adapter for a braille display. Remove brltty"
    return Complaint("brltty", text, NO_BRLTTY)


def _modem_manager(machine: Machine, rules: Rules, adapter: "Adapter") -> Complaint | None:
    if adapter.vid is None or not machine.runs("ModemManager") or _ignored(rules, adapter):
        return None
    text = (
        "ModemManager is running and may mistake a new adapter for a modem, which keeps the port busy for some "
        f"seconds. Paste the udev rule into {RULE_FILE} and run `{RELOAD}`, or disable ModemManager"
    )
    return Complaint("modem_manager", text, NO_MODEM_MANAGER)


def _claims(rules: Rules, numbers: tuple[int | None, int | None]) -> bool:
    """Return whether brltty's udev rules include this type of adapter."""
    vid, pid = numbers
    if vid is None or pid is None:
        return False
    return any(f"{vid:x}/{pid:x}" in text for name, text in rules.items() if "brltty" in name)


def _ignored(rules: Rules, adapter: "Adapter") -> bool:
    """Return whether a udev rule makes ModemManager ignore this vendor's adapters."""
    lines = (line for text in rules.values() for line in text.splitlines())
    return any("id_mm_device_ignore" in line and f'"{adapter.vid:04x}"' in line for line in lines)


def _text(numbers: tuple[int, int]) -> str:
    return f"{numbers[0]:04x}:{numbers[1]:04x}"


@dataclass(frozen=True, slots=True)
class Adapter:
    """One serial port. ``vid`` and ``pid`` are None if the port does not belong to a USB adapter."""

    device: str
    vid: int | None
    pid: int | None
    chip: str
    product: str | None
    serial_number: str | None
    by_id: str | None
    permission: PortPermission | None
    """The user's permission for the device; None if the device has disappeared."""
    latency_ms: int | None
    """Latency timer; None if the adapter does not have one."""
    holders: tuple[Holder, ...]
    complaints: tuple[Complaint, ...] = ()


@dataclass(frozen=True, slots=True)
class PortsReport:
    """All serial adapters of the machine."""

    adapters: tuple[Adapter, ...]
    complaints: tuple[Complaint, ...]
    """Problems that are not specific to a single adapter."""
    udev_rule: str
    """Lines of a udev rule file for these adapters."""


def ports(machine: Machine | None = None) -> PortsReport:
    """Examine all serial adapters without opening their ports."""
    machine = machine or Machine()
    found = [_adapter(machine, info) for info in sorted(machine.comports(), key=lambda info: info.device)]
    rules = machine.udev_rules()
    judged = tuple(replace(one, complaints=adapter_complaints(machine, rules, one)) for one in found)
    return PortsReport(judged, machine_complaints(machine, rules) + alike(judged), udev_rule(judged))


def only_port(machine: Machine | None = None) -> str:
    """Return the device path of the only USB adapter. Raises CommissioningError if there is no adapter, or more than
    one."""
    report = ports(machine)
    devices = [one.device for one in report.adapters if one.vid is not None]
    if len(devices) == 1:
        return devices[0]
    if devices:
        raise CommissioningError(f"there are {len(devices)} USB adapters: choose one of {', '.join(devices)}")
    others = ", ".join(one.device for one in report.adapters)
    hint = f"plug in an adapter or specify the port ({others})" if others else "plug in an adapter or specify the port"
    why = "".join(f"; {complaint}" for complaint in report.complaints)
    raise CommissioningError(f"no USB adapter was found: {hint}{why}")


def _adapter(machine: Machine, info: ListPortInfo) -> Adapter:
    vid, pid, device = info.vid, info.pid, info.device
    usb = vid is not None and pid is not None
    return Adapter(
        device=device,
        vid=vid if usb else None,
        pid=pid if usb else None,
        chip=chip_text(vid, pid) if usb else "not a USB adapter",
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
    except (OSError, ValueError):  # Only some adapters have a latency timer.
        return None
