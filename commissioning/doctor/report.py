"""Report of the doctor: ranked findings with the underlying measurements, also as Markdown."""

import platform
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from commissioning.doctor.checks.identity import firmware
from commissioning.doctor.findings import Finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, LineFigures, ServoSnapshot, Stranger
from commissioning.ports.adapters import Adapter


@dataclass(frozen=True, slots=True)
class ServoFigures:
    """Measurements of one servo. Unknown values are None."""

    joint: str
    servo_id: int
    model: str
    heard: str
    firmware: str | None = None
    position: float | None = None
    """Joint position, in rad or m."""
    voltage_v: tuple[float, float] | None = None
    """Lowest and highest voltage at rest."""
    temperature_c: float | None = None
    load: float | None = None
    torque: bool | None = None
    alarms: tuple[str, ...] = ()
    registers: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BusFigures:
    """Measurements of one bus."""

    name: str
    port: str
    baud: int
    problem: str | None
    line: LineFigures | None
    servos: tuple[ServoFigures, ...]
    strangers: tuple[Stranger, ...]


@dataclass(frozen=True, slots=True)
class DoctorReport:
    """Findings and measurements of an arm."""

    findings: tuple[Finding, ...]
    """Findings, most likely cause first."""
    buses: tuple[BusFigures, ...]
    adapters: tuple[str, ...] = ()
    """Serial adapters of the machine, with their chips and USB IDs."""

    @property
    def healthy(self) -> bool:
        """Whether there are no faults. A healthy arm may still have warnings and notes."""
        return not any(finding.severity == "fault" for finding in self.findings)


def report_of(snapshot: ArmSnapshot, findings: tuple[Finding, ...], adapters: Iterable[Adapter] = ()) -> DoctorReport:
    """Return a report with the findings and the measurements of the snapshot."""
    return DoctorReport(findings, tuple(_bus(bus) for bus in snapshot.buses), tuple(map(_adapter, adapters)))


def _adapter(adapter: Adapter) -> str:
    numbers = "" if adapter.vid is None else f", {adapter.vid:04x}:{adapter.pid:04x}"
    latency = "" if adapter.latency_ms is None else f", latency timer {adapter.latency_ms} ms"
    return f"{adapter.device}: {adapter.chip}{numbers}{latency}"


def _bus(bus: BusSnapshot) -> BusFigures:
    return BusFigures(
        bus.name, bus.port, bus.baud, bus.problem, bus.line, tuple(map(_servo, bus.servos)), bus.strangers
    )


def _servo(servo: ServoSnapshot) -> ServoFigures:
    joint = servo.joint
    if not servo.states:
        return ServoFigures(joint.name, joint.servo_id, joint.model.name, servo.heard)
    state, volts = servo.states[-1], [one.voltage_v for one in servo.states]
    return ServoFigures(
        joint.name,
        joint.servo_id,
        joint.model.name,
        servo.heard,
        firmware(servo),
        round(joint.position(state.position_counts), 4),
        (round(min(volts), 1), round(max(volts), 1)),
        state.temperature_c,
        round(state.load, 3),
        servo.holds,
        state.alarms,
        dict(servo.registers),
    )


PACKAGES: Final = ("servoloop", "pyserial", "feetech-servo-sdk", "dynamixel-sdk")


def markdown(report: DoctorReport, user: str, robot: Path | None = None) -> str:
    """Return the report as Markdown, for a bug report.

    Args:
        report: The report.
        user: Name of the user. The user name, the host name and all home folders are removed from the report.
        robot: Robot file to include.
    """
    return without_names("\n".join(_lines(report, robot)) + "\n", user, platform.node())


def without_names(text: str, user: str, host: str) -> str:
    """Return the text after replacing the user name, the host name and all home folders."""
    text = re.sub(r"/home/[^/\s'\"`]+", "~", text)
    for name, instead in ((user, "$USER"), (host, "$HOST")):
        if name and name != "root":
            text = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", instead, text)
    return text


def _lines(report: DoctorReport, robot: Path | None) -> Iterator[str]:
    yield from ("# servoloop doctor", "", "## Findings", "")
    yield from _findings(report.findings)
    yield from ("", "## Versions", "")
    yield f"- Python {platform.python_version()}, {platform.system()} {platform.release()}, {platform.machine()}"
    yield from (f"- {name} {_version(name)}" for name in PACKAGES)
    yield from ("", "## Adapters", "")
    yield from (f"- {one}" for one in report.adapters or ("none known",))
    for bus in report.buses:
        yield from _bus_lines(bus)
    if robot is not None:
        yield from ("", f"## {robot.name}", "", "```yaml", robot.read_text().rstrip(), "```")


def _findings(findings: Iterable[Finding]) -> Iterator[str]:
    number = 0
    for number, one in enumerate(findings, 1):
        where = f" {one.place}:" if str(one.place) else ""
        yield f"{number}. **{one.severity}** `{one.id}`{where} {one.symptom}. {one.cause}."
        if one.command:
            yield f"   Run `{one.command}`"
    if not number:
        yield "No problems found."


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _bus_lines(bus: BusFigures) -> Iterator[str]:
    yield from ("", f"## Bus {bus.name} {bus.port}, {bus.baud} baud".replace("  ", " "), "")
    if bus.problem:
        yield f"- port: {bus.problem}"
    if line := bus.line:
        yield (
            f"- {line.asked} requests: {line.lost} replies lost, {line.corrupt} corrupt, {line.late} late; noise "
            f"received {line.noise} times"
        )
        if line.round_trip_s is not None:
            yield f"- a read takes {1e3 * line.round_trip_s:.2f} ms, of which its bytes need {1e3 * line.wire_s:.2f} ms"
        if line.cycle_s:
            most_hz = 1.0 / line.cycle_s
            yield f"- reading all states takes {1e3 * line.cycle_s:.2f} ms: update_rate must be below {most_hz:.0f}"
    yield from (f"- unexpected servo: ID {one.servo_id}, {one.model or 'unknown model'}" for one in bus.strangers)
    yield from ("", "| joint | ID | model | heard | firmware | position | V | °C | load | torque | alarms |")
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    yield from (_row(servo) for servo in bus.servos)
    yield from _registers([servo for servo in bus.servos if servo.registers])


def _row(one: ServoFigures) -> str:
    volts = "" if one.voltage_v is None else f"{one.voltage_v[0]} to {one.voltage_v[1]}"
    values = (one.joint, one.servo_id, one.model, one.heard, one.firmware, one.position, volts, one.temperature_c,
              one.load, one.torque, ", ".join(one.alarms))  # fmt: skip
    return "| " + " | ".join("" if value is None else str(value) for value in values) + " |"


def _registers(servos: list[ServoFigures]) -> Iterator[str]:
    """Return the rows of a table of all registers, with one column per servo."""
    if servos:
        yield from ("", "| register | " + " | ".join(str(one.servo_id) for one in servos) + " |")
        yield "|---" * (len(servos) + 1) + "|"
    for name in dict.fromkeys(name for one in servos for name in one.registers):
        yield f"| {name} | " + " | ".join(str(one.registers.get(name, "")) for one in servos) + " |"
