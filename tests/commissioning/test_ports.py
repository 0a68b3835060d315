"""Each problem with adapters is recognized on a simulated machine, and a healthy machine has none."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from commissioning.commissioning_errors import CommissioningError
from commissioning.ports import machine as permissions
from commissioning.ports.adapters import only_port, ports
from commissioning.ports.chips import CHIPS, chip_text
from commissioning.ports.machine import Holder, Machine, User
from commissioning.ports.plugging import SETTLE_S, wait_for_plugging
from servoloop import cli
from sim_backend.clock import SimulatedClock
from tests.commissioning.machines import BRLTTY_RULES, STRANGER, SmallMachine
from tests.servoloop.served import eventually

ACM, USB = "/dev/ttyACM0", "/dev/ttyUSB0"
RULES = "usr/lib/udev/rules.d/85-brltty.rules"


def healthy(small: SmallMachine) -> None:
    small.plug(ACM)
    small.plug(USB, 0x0403, 0x6014, "FT6S4DSP")
    small.latency(USB, 1)
    small.run(77, "bash", ["/dev/pts/0"])
    small.file(RULES, BRLTTY_RULES)  # these rules are for a CH340, which is not plugged in


def in_use(small: SmallMachine) -> None:
    small.plug(ACM)
    small.run(812, "python3", ["/dev/null", ACM])


def slow(small: SmallMachine) -> None:
    small.plug(USB, 0x0403, 0x6014, "FT6S4DSP")
    small.latency(USB, 16)


def braille(small: SmallMachine) -> None:
    small.plug(USB, 0x1A86, 0x7523, "X1")
    small.file(RULES, BRLTTY_RULES)


def modem(small: SmallMachine) -> None:
    small.plug(ACM)
    small.run(640, "ModemManager")


CASES: list[tuple[Callable[[SmallMachine], None], str, str | None]] = [
    (in_use, "in_use", None),
    (slow, "latency", "latency_timer"),
    (braille, "brltty", "sudo apt-get remove brltty"),
    (modem, "modem_manager", "ModemManager"),
]


@pytest.mark.parametrize(("made", "kind", "command"), CASES, ids=lambda a: getattr(a, "__name__", None))
def test_each_port_problem_is_recognized(
    made: Callable[[SmallMachine], None], kind: str, command: str | None, tmp_path: Path
) -> None:
    small = SmallMachine(tmp_path)
    made(small)
    report = ports(small.machine)
    ((complaint,),) = [one.complaints for one in report.adapters]
    assert complaint.kind == kind
    assert report.complaints == ()
    assert (command or "") in (complaint.command or "") and bool(command) is bool(complaint.command)


def test_a_healthy_machine_has_no_problems(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    healthy(small)
    report = ports(small.machine)
    assert [one.complaints for one in report.adapters] == [(), ()]
    assert report.complaints == ()
    first, second = report.adapters
    assert (first.device, first.by_id, first.serial_number) == (ACM, "/dev/serial/by-id/usb-5A46-if00", "5A46")
    assert "CH343" in first.chip and "U2D2" in second.chip
    assert (first.latency_ms, second.latency_ms) == (None, 1)


def test_a_machine_without_adapters_has_no_problems(tmp_path: Path) -> None:
    assert ports(SmallMachine(tmp_path).machine) == ports(SmallMachine(tmp_path / "other").machine)
    assert ports(SmallMachine(tmp_path).machine).complaints == ()


# Permission


@pytest.mark.parametrize(
    ("mode", "uid", "groups", "may"),
    [
        (0o660, 1, {5}, True),  # the owner may read and write
        (0o060, 1, {5}, False),  # for the owner, only the owner's bits count
        (0o660, 2, {5}, True),
        (0o600, 2, {5}, False),
        (0o640, 2, {5}, False),  # read permission alone is not enough
        (0o666, 2, {6}, True),
        (0o660, 2, {6}, False),
        (0o000, 0, {6}, True),  # root
    ],
)
def test_permission_follows_the_kernel_rule(mode: int, uid: int, groups: set[int], may: bool) -> None:
    assert permissions._may_open(User("u", uid, frozenset(groups)), 1, 5, mode) is may


def test_missing_permission_names_the_group_and_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = SmallMachine(tmp_path, STRANGER)
    small.plug(ACM)
    monkeypatch.setattr(permissions, "_group", lambda group_id: ("uucp", ["somebody"]))
    (complaint,) = ports(small.machine).adapters[0].complaints
    assert (complaint.kind, complaint.command) == ("permission", "sudo usermod -aG uucp stranger")
    assert "'uucp'" in complaint.text


def test_a_new_group_member_is_told_to_log_in_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = SmallMachine(tmp_path, STRANGER)
    small.plug(ACM)
    monkeypatch.setattr(permissions, "_group", lambda group_id: ("dialout", ["stranger"]))
    (complaint,) = ports(small.machine).adapters[0].complaints
    assert (complaint.kind, complaint.command) == ("login", "newgrp dialout")


def test_joining_the_group_root_is_never_recommended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = SmallMachine(tmp_path, STRANGER)
    small.plug(ACM)
    monkeypatch.setattr(permissions, "_group", lambda group_id: ("root", []))
    (complaint,) = ports(small.machine).adapters[0].complaints
    assert complaint.command == "sudo usermod -aG dialout stranger"
    assert "udev rule" in complaint.text


# Programs that take over ports


def test_an_adapter_that_brltty_took_is_named(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.usb("1-2", 0x1A86, 0x7523, None)
    small.file(RULES, BRLTTY_RULES)
    (complaint,) = ports(small.machine).complaints
    assert (complaint.kind, complaint.command) == ("brltty", "sudo apt-get remove brltty")
    assert "1a86:7523" in complaint.text


def test_an_adapter_without_a_driver_is_not_blamed_on_brltty(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.usb("1-2", 0x1A86, 0x7523, None)
    (complaint,) = ports(small.machine).complaints
    assert (complaint.kind, complaint.command) == ("no_port", "sudo modprobe ch341")


@pytest.mark.parametrize("mask", ["", "# nothing\n"])
def test_a_masked_brltty_rule_is_ignored(mask: str, tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    braille(small)
    small.file("etc/udev/rules.d/85-brltty.rules", mask)
    assert ports(small.machine).adapters[0].complaints == ()


def test_comments_in_udev_rules_are_ignored(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug(USB, 0x10C4, 0xEA60, "0001")
    small.file(RULES, BRLTTY_RULES)
    assert ports(small.machine).adapters[0].complaints == ()


def test_the_recommended_udev_rule_solves_both_problems(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    modem(small)
    small.plug(USB, 0x0403, 0x6014, "FT6S4DSP")
    rule = ports(small.machine).udev_rule
    assert 'ATTRS{serial}=="FT6S4DSP", GROUP="dialout", MODE="0660"' in rule
    assert 'ATTR{latency_timer}="1"' in rule
    small.file("etc/udev/rules.d/99-servos.rules", rule)
    assert [one.complaints for one in ports(small.machine).adapters] == [(), ()]


def test_identical_adapters_without_serial_numbers_are_reported(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug(USB, 0x1A86, 0x7523, None)
    assert ports(small.machine).complaints == ()
    small.plug("/dev/ttyUSB1", 0x1A86, 0x7523, None)
    (complaint,) = ports(small.machine).complaints
    assert complaint.kind == "alike" and "/dev/ttyUSB0 and /dev/ttyUSB1" in complaint.text


@pytest.mark.parametrize("numbers", sorted(CHIPS))
def test_every_chip_with_a_kernel_driver_of_its_own_is_named(numbers: tuple[int, int]) -> None:
    assert CHIPS[numbers].name in chip_text(*numbers)
    assert CHIPS[numbers].driver in ("ch341", "cdc_acm", "cp210x", "ftdi_sio")
    assert chip_text(0x1234, 0x5678) == "unknown chip"


def test_a_program_that_has_the_port_open_is_found_by_name(tmp_path: Path) -> None:
    device = tmp_path / "device"
    device.touch()
    machine = Machine()
    with device.open() as opened:
        assert machine.holders(str(device)) == ()  # files that this process has opened do not count
        other = subprocess.Popen(["sleep", "60"], stdin=opened)
    try:
        # At first, the child has the name of this program.
        eventually(lambda: machine.holders(str(device)) == (Holder(other.pid, "sleep 60"),))
        assert machine.runs("sleep") and not machine.runs("no such program")
    finally:
        other.kill()
        other.wait()


# Which one


def test_only_port_requires_exactly_one_adapter(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    with pytest.raises(CommissioningError, match=r"no USB adapter was found: plug in an adapter or specify the port$"):
        only_port(small.machine)
    small.plug(ACM)
    assert only_port(small.machine) == ACM
    small.plug(USB)
    with pytest.raises(CommissioningError, match="there are 2 USB adapters: choose one of /dev/ttyACM0, /dev/ttyUSB0"):
        only_port(small.machine)


class Later(SimulatedClock):
    """A clock that changes the machine at given times."""

    def __init__(self, happens: dict[float, Callable[[], Any]]) -> None:
        super().__init__(0.0)
        self.happens = happens

    def sleep_until(self, deadline_s: float) -> None:
        for at_s in sorted(self.happens):
            if at_s <= deadline_s:
                self.happens.pop(at_s)()
        super().sleep_until(deadline_s)


def test_a_plugged_in_adapter_is_named_with_its_udev_group(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug(ACM)
    opened = lambda: (tmp_path / "dev/ttyUSB0").chmod(0o664)  # noqa: E731
    clock = Later({2.0: lambda: small.plug(USB, mode=0o600), 2.0 + 0.8 * SETTLE_S: opened})
    plugged = wait_for_plugging(10.0, small.machine, clock)
    assert (plugged.happened, plugged.adapter.device) == ("plugged", USB)
    assert plugged.adapter.permission and plugged.adapter.permission.mode == "0664"
    assert clock.now() < 3.5


def test_an_unplugged_adapter_is_named(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug(ACM)
    small.plug(USB)
    plugged = wait_for_plugging(10.0, small.machine, Later({1.0: lambda: small.infos.pop(0)}))
    assert (plugged.happened, plugged.adapter.device) == ("pulled", ACM)


def test_a_vanished_port_is_named_with_the_reason(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.file(RULES, BRLTTY_RULES)

    def taken() -> None:
        small.infos.clear()
        small.usb("1-9", 0x1A86, 0x7523, None)

    clock = Later({1.0: lambda: small.plug(USB, 0x1A86, 0x7523), 1.5: taken})
    plugged = wait_for_plugging(10.0, small.machine, clock)
    assert plugged.happened == "vanished"
    assert "brltty" in plugged.why and "sudo apt-get remove brltty" in plugged.why


def test_waiting_ends(tmp_path: Path) -> None:
    clock = Later({})
    with pytest.raises(CommissioningError, match=r"within 5 s.*different cable"):
        wait_for_plugging(5.0, SmallMachine(tmp_path).machine, clock)
    assert clock.now() == pytest.approx(5.0)


# The command line


@pytest.mark.parametrize("as_json", [True, False])
def test_the_ports_command_prints_all_adapters(
    as_json: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    small = SmallMachine(tmp_path)
    slow(small)
    monkeypatch.setattr("commissioning.ports.adapters.Machine", lambda: small.machine)
    monkeypatch.setattr(sys, "argv", ["servoloop", "ports", *(["--json"] if as_json else [])])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    assert exit_.value.code == 0
    out = capsys.readouterr().out
    if as_json:
        (adapter,) = json.loads(out)["adapters"]
        assert (adapter["device"], adapter["latency_ms"], adapter["complaints"][0]["kind"]) == (USB, 16, "latency")
    else:
        assert USB in out and "U2D2" in out and "99-servos.rules" in out and f"{os.sep}latency_timer" in out
