"""The doctor: measures all buses of a robot, judges what it found, and reports.

report = doctor(robot, {"": "/dev/ttyACM0"}, MonotonicClock())
for finding in report.findings:
    print(finding.severity, finding.symptom, finding.cause, finding.command)
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from commissioning.doctor.judge import judge
from commissioning.doctor.measure import OpenPort, measure_bus
from commissioning.doctor.motion import Move, no_move
from commissioning.doctor.report import Report, report_of
from commissioning.doctor.snapshot import Snapshot
from commissioning.ports.adapters import ports
from commissioning.ports.machine import Machine
from drivers.clock import Clock
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from hal.robot_file.calibration_file import CalibrationFile
from hal.robot_file.robot import Robot


def doctor(
    robot: Robot,
    devices: Mapping[str, str],
    clock: Clock,
    *,
    arm: str = "NAME",
    calibration: CalibrationFile | None = None,
    machine: Machine | None = None,
    open_port: OpenPort | None = None,
    move: Move = no_move,
) -> Report:
    """Examine the servos of a robot. ``devices``: the port of each bus, by the bus's name; ``arm``: its name on
    the command line, for the commands that mend.

    Only pings and reads, and torque stays as it is, unless ``move`` moves the joints (commissioning/doctor/motion.py).
    What is wrong is never raised: it stands in the report.
    """
    opened = open_port or partial(_serial, clock)
    lines = robot.file.lines()
    buses = tuple(
        measure_bus(name, device, lines[name].baud, [j for j in robot.joints if j.bus == name], opened, clock)
        for name, device in devices.items()
    )
    adapters = ports(machine)
    snapshot = Snapshot(buses, calibration, arm)
    motions, why_not = move(snapshot, judge(snapshot, adapters))
    snapshot = replace(snapshot, motions=motions, not_moved=why_not)
    return report_of(snapshot, judge(snapshot, adapters), adapters.adapters)


def _serial(clock: Clock, device: str, baud: int) -> Port:
    return SerialPort(device, baud, clock)
