"""What servos are: the model that the robot file says, and firmware, by what it can do and not by its number."""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import BusSnapshot, ServoSnapshot, Snapshot
from drivers.servos.catalog import known_as, series_of

VERSIONS: Final = (("firmware_major", "firmware_minor"), ("firmware_version",))


def check_identity(snapshot: Snapshot) -> Iterator[Finding]:
    """Every servo that answers."""
    for bus in snapshot.buses:
        for servo in bus.servos:
            yield from _model(bus, servo)
        yield from _firmware(bus)


def _model(bus: BusSnapshot, servo: ServoSnapshot) -> Iterator[Finding]:
    number, model = servo.registers.get("model_number"), servo.joint.model
    if number is None or number == model.number:
        return
    cause = (
        f"it says model number {number} ({known_as(number, series_of(model))}), and the robot file says {model.name} "
        f"({model.number}): correct the robot file, or swap the servo"
    )
    yield finding("wrong_model", place_of(bus, servo), "refused at start-up: it is another model", cause)


def firmware(servo: ServoSnapshot) -> str | None:
    """Its version as text; None where it is unknown."""
    for names in VERSIONS:
        if all(name in servo.registers for name in names):
            return ".".join(str(servo.registers[name]) for name in names)
    return None


def _firmware(bus: BusSnapshot) -> Iterator[Finding]:
    versions: dict[tuple[str, str], list[str]] = {}
    for servo in bus.servos:
        if version := firmware(servo):
            versions.setdefault((servo.joint.model.name, version), []).append(str(servo.joint.servo_id))
    models = {model for model, _ in versions}
    if len(versions) == len(models):
        return
    said = "; ".join(f"{model} {version}: {', '.join(ids)}" for (model, version), ids in sorted(versions.items()))
    cause = f"servos of one model have several versions ({said}). All that is asked of them here they have answered"
    yield finding("firmware_differs", Place(bus=bus.name), "other programs refuse the arm for its firmware", cause)
