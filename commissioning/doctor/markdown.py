"""The report as a text to attach to a bug report: it names neither its user nor the machine."""

import platform
import re
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from commissioning.doctor.finding import Finding
from commissioning.doctor.report import BusFigures, Report, ServoFigures

PACKAGES: Final = ("servoloop", "pyserial", "feetech-servo-sdk", "dynamixel-sdk")


def markdown(report: Report, user: str, robot: Path | None = None) -> str:
    """``user`` and home folders are taken out wherever they stand; ``robot``: the robot file, which goes along."""
    return without_names("\n".join(_lines(report, robot)) + "\n", user, platform.node())


def without_names(text: str, user: str, host: str) -> str:
    """The text without the names of user and machine, and of anybody's home folder."""
    text = re.sub(r"/home/[^/\s'\"`]+", "~", text)
    for name, instead in ((user, "$USER"), (host, "$HOST")):
        if name and name != "root":
            text = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", instead, text)
    return text


def _lines(report: Report, robot: Path | None) -> Iterator[str]:
    yield from ("# servoloop doctor", "", "## Findings", "")
    yield from _findings(report.findings)
    yield from ("", "## Versions", "")
    yield f"- Python {platform.python_version()}, {platform.system()} {platform.release()}, {platform.machine()}"
    yield from (f"- {name} {_version(name)}" for name in PACKAGES)
    yield from ("", "## Adapters", "")
    yield from (f"- {one}" for one in report.adapters or ("none is known",))
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
        yield "Nothing is wrong."


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
        yield f"- {line.asked} questions: {line.lost} lost, {line.corrupt} broken, {line.late} late, {line.noise} noise"
        if line.round_trip_s is not None:
            yield f"- a read takes {1e3 * line.round_trip_s:.2f} ms, its bytes {1e3 * line.wire_s:.2f} ms"
    yield from (f"- stranger: ID {one.servo_id}, {one.model or 'unknown model'}" for one in bus.strangers)
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
    """A column for each servo."""
    if servos:
        yield from ("", "| register | " + " | ".join(str(one.servo_id) for one in servos) + " |")
        yield "|---" * (len(servos) + 1) + "|"
    for name in dict.fromkeys(name for one in servos for name in one.registers):
        yield f"| {name} | " + " | ".join(str(one.registers.get(name, "")) for one in servos) + " |"
