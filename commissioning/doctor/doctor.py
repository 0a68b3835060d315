"""Diagnose an arm: measure all buses of a robot, run all checks, and return a report.

report = doctor(ExaminedArm(robot), {"": "/dev/ttyACM0"}, MonotonicClock())
for finding in report.findings:
    print(finding.severity, finding.symptom, finding.cause, finding.command)
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
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
from commissioning.doctor.findings import KINDS, Finding, ranked
from commissioning.doctor.measure import OpenPort, measure_bus
from commissioning.doctor.motion import Move, no_move
from commissioning.doctor.report import DoctorReport, report_of
from commissioning.doctor.snapshot import ArmSnapshot
from commissioning.ports.adapters import PortsReport, ports
from commissioning.ports.machine import Machine
from drivers.clock import Clock
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from hal.robot_file.calibration_file import CalibrationFile
from hal.robot_file.robot import Robot

CHECKS: Final[tuple[Callable[[ArmSnapshot], Iterable[Finding]], ...]] = (
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


def judge(snapshot: ArmSnapshot, ports: PortsReport | None = None) -> tuple[Finding, ...]:
    """Return all findings for a snapshot, starting with the finding that most likely causes the others."""
    return ranked(_all(snapshot, ports), KINDS)


def _all(snapshot: ArmSnapshot, ports: PortsReport | None) -> Iterator[Finding]:
    yield from check_ports(snapshot, ports)
    for check in CHECKS:
        yield from check(snapshot)


@dataclass(frozen=True, slots=True)
class ExaminedArm:
    """Arm to examine."""

    robot: Robot
    name: str = "NAME"
    """Name of the arm on the command line, for the commands that the findings recommend."""
    calibration: CalibrationFile | None = None
    """Calibration of the arm; None if it is not calibrated."""


def doctor(
    arm: ExaminedArm,
    devices: Mapping[str, str],
    clock: Clock,
    *,
    machine: Machine | None = None,
    open_port: OpenPort | None = None,
    move: Move = no_move,
) -> DoctorReport:
    """Examine the servos of an arm and return a report.

    The function only sends pings and reads. Torque does not change unless ``move`` moves the joints
    (commissioning/doctor/motion.py). Problems of the arm do not raise exceptions, but are reported as findings. The
    report contains these findings.

    Args:
        arm: The arm.
        devices: Serial port of each bus, keyed by bus name.
        clock: Clock for all timing.
        machine: Machine whose serial adapters are listed. If None, this machine is used.
        open_port: Function that opens a device at a baud rate. If None, serial ports are opened.
        move: Function that moves the joints for the checks that require motion.
    """
    opened = open_port or partial(_serial, clock)
    lines = arm.robot.file.lines()
    buses = tuple(
        measure_bus(name, device, lines[name].baud, [j for j in arm.robot.joints if j.bus == name], opened, clock)
        for name, device in devices.items()
    )
    adapters = ports(machine)
    snapshot = ArmSnapshot(buses, arm.calibration, arm.name)
    snapshot = replace(snapshot, motion_test=move(snapshot, judge(snapshot, adapters)))
    return report_of(snapshot, judge(snapshot, adapters), adapters.adapters)


def _serial(clock: Clock, device: str, baud: int) -> Port:
    return SerialPort(device, baud, clock)
