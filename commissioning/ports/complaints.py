"""What stands between a program and an adapter's servos, each with the command that mends it.

A rule of brltty's, and ModemManager's habit to try new ports, are known from lerobot #497 and #1582 and from many
owners of CH340, CP2102 and FTDI adapters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from commissioning.ports.chips import CHIPS
from commissioning.ports.machine import Machine
from commissioning.ports.udev import RELOAD, RULE_FILE
from drivers.port.latency import latency_advice

if TYPE_CHECKING:
    from commissioning.ports.adapters import Adapter

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
