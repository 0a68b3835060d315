"""Port problems on simulated machines are reported with the command that fixes them."""

from pathlib import Path

import pytest

from commissioning.doctor.checks.port import check_ports
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot
from commissioning.ports.adapters import Adapter, Complaint, PortsReport
from drivers.driver_errors import PortDenied, PortMissing
from sim_backend.buses.port import VirtualPort
from tests.commissioning.machines import BRLTTY_RULES, STRANGER, SmallMachine
from tests.commissioning.patient import Patient

ACM, USB = "/dev/ttyACM0", "/dev/ttyUSB0"


def patient_on(small: SmallMachine, device: str = ACM, **options: object) -> Patient:
    """Return a patient on this machine whose port is ``device``."""
    patient = Patient(machine=small.machine, **options)  # type: ignore[arg-type]
    patient.device = device
    return patient


def test_a_moved_port_is_reported_with_its_permanent_name(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug("/dev/ttyACM1")
    first = patient_on(small, open_error=PortMissing(f"there is no {ACM}")).examine().findings
    assert [one.id for one in first] == ["port_moved"]
    assert "/dev/ttyACM1" in first[0].cause and "5A46" in first[0].cause
    assert first[0].command == "servoloop doctor --arm NAME --port /dev/serial/by-id/usb-5A46-if00"


def test_a_moved_port_of_one_of_two_buses_is_reported_with_both_ports(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug(f"{ACM}-hand", serial="HAND")
    small.plug("/dev/ttyACM1")
    patient = patient_on(small, arm="robot_arm_two_buses.yaml")
    opened = patient.open

    def open_hand(device: str, baud: int) -> VirtualPort:
        if device == f"{ACM}-arm":
            raise PortMissing(f"there is no {device}")
        return opened(device, baud)

    patient.open = open_hand  # type: ignore[method-assign]
    first = patient.examine().findings[0]
    assert (first.id, first.place.bus) == ("port_moved", "arm")
    ports = f"--port arm=/dev/serial/by-id/usb-5A46-if00 --port hand={ACM}-hand"
    assert first.command == f"servoloop doctor --arm NAME {ports}"


def test_a_port_without_any_adapter_is_missing(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    found = patient_on(small, open_error=PortMissing(f"there is no {ACM}: plug in the adapter")).examine().findings
    assert [one.id for one in found] == ["port_missing"]


def test_an_adapter_taken_by_brltty_is_found(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.usb("1-1", 0x1A86, 0x7523, None)
    small.file("usr/lib/udev/rules.d/85-brltty.rules", BRLTTY_RULES)
    found = patient_on(small, USB, open_error=PortMissing(f"there is no {USB}")).examine().findings
    assert [one.id for one in found] == ["port_taken_by_brltty"]
    assert found[0].command == "sudo apt-get remove brltty"


def test_an_adapter_without_a_driver_is_found(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.usb("1-1", 0x1A86, 0x7523, None)
    found = patient_on(small, USB, open_error=PortMissing(f"there is no {USB}")).examine().findings
    assert [(one.id, one.command) for one in found] == [("port_without_driver", "sudo modprobe ch341")]


def test_a_denied_port_is_reported_with_the_group_command(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path, STRANGER)
    small.plug(ACM, mode=0o600)
    found = patient_on(small, open_error=PortDenied(f"no permission to open {ACM}")).examine().findings
    assert found[0].id == "port_denied"
    assert "usermod -aG" in (found[0].command or "")


@pytest.mark.parametrize(
    ("kind", "command"),
    [("latency_timer", "latency_timer"), ("brltty_present", "brltty"), ("modem_manager", "ModemManager")],
)
def test_slow_or_unreliable_ports_are_found(tmp_path: Path, kind: str, command: str) -> None:
    small = SmallMachine(tmp_path)
    if kind == "latency_timer":
        small.plug(USB, 0x0403, 0x6014)
        small.latency(USB, 16)
    elif kind == "brltty_present":
        small.plug(USB, 0x1A86, 0x7523)
        small.file("usr/lib/udev/rules.d/85-brltty.rules", BRLTTY_RULES)
    else:
        small.plug(USB)
        small.run(640, "ModemManager")
    report = patient_on(small, USB).examine()
    assert [one.id for one in report.findings] == [kind]
    assert command in (report.findings[0].command or "")
    assert report.healthy, "warnings block nothing"


def test_a_good_adapter_has_no_findings(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug(ACM)
    assert patient_on(small).examine().findings == ()


def test_identical_adapters_without_serial_numbers_are_found(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug(ACM, serial=None)
    small.plug("/dev/ttyACM1", serial=None)
    assert [one.id for one in patient_on(small).examine().findings] == ["adapters_alike"]


def adapter(device: Path, by_id: Path | None = None, complaints: tuple[Complaint, ...] = ()) -> Adapter:
    name = None if by_id is None else str(by_id)
    serial = None if by_id is None else "5A46"
    return Adapter(str(device), 0x1A86, 0x7523, "CH340", None, serial, name, None, None, (), complaints)


def linked(tmp_path: Path, name: str, device: Path) -> Path:
    """Return a link to a device, as in /dev/serial/by-path."""
    device.touch()
    (tmp_path / name).symlink_to(device)
    return tmp_path / name


def test_the_adapter_of_another_bus_is_not_offered_in_place_of_a_missing_one(tmp_path: Path) -> None:
    """The other bus was opened through a link in /dev/serial/by-path."""
    device = tmp_path / "ttyUSB0"
    left = BusSnapshot("left", str(linked(tmp_path, "by-path", device)), 1_000_000)
    right = BusSnapshot("right", str(tmp_path / "ttyUSB1"), 1_000_000, problem="missing", problem_text="it is gone")
    snapshot = ArmSnapshot((left, right), arm="bimanual_so101")
    by_id = linked(tmp_path, "by-id", device)
    for report in (PortsReport((adapter(device),), (), ""), PortsReport((adapter(device, by_id),), (), "")):
        assert [one.id for one in check_ports(snapshot, report)] == ["port_missing"]


def test_the_problem_of_an_adapter_is_found_if_its_port_is_given_as_another_link(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    bus = BusSnapshot("", str(linked(tmp_path, "by-path", device)), 1_000_000)
    slow = Complaint("latency", "the adapter delays every reply", "echo 1")
    report = PortsReport((adapter(device, complaints=(slow,)),), (), "")
    assert [one.id for one in check_ports(ArmSnapshot((bus,)), report)] == ["latency_timer"]


def test_a_moved_port_without_a_permanent_name_is_reported_by_its_device(tmp_path: Path) -> None:
    small = SmallMachine(tmp_path)
    small.plug("/dev/ttyACM1", serial=None)
    first = patient_on(small, open_error=PortMissing(f"there is no {ACM}")).examine().findings[0]
    assert (first.id, first.command) == ("port_moved", "servoloop doctor --arm NAME --port /dev/ttyACM1")
    assert first.cause.startswith("The only other adapter is at /dev/ttyACM1 (")
    assert "None" not in first.cause and "change" not in first.cause
