"""Check the model numbers and the firmware versions of the servos."""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot
from drivers.servos.catalog import known_as, series_of, unsupported

VERSIONS: Final = (("firmware_major", "firmware_minor"), ("firmware_version",))


def check_identity(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every servo that responds."""
    for bus in snapshot.buses:
        for servo in bus.servos:
            yield from _model(bus, servo)
        yield from _firmware(bus)


def _model(bus: BusSnapshot, servo: ServoSnapshot) -> Iterator[Finding]:
    number, model = servo.registers.get("model_number"), servo.joint.model
    if number is None or number == model.number:
        return
    series = series_of(model)
    reads = "; its control table is not supported, so it can only be read" if unsupported(number, series) else ""
    cause = (
        f"The servo reports model number {number} ({known_as(number, series)}{reads}), but the robot file has "
        f"{model.name} ({model.number}). Correct the robot file, or replace the servo"
    )
    yield finding("wrong_model", place_of(bus, servo), "the arm does not start: the servo is another model", cause)


def firmware(servo: ServoSnapshot) -> str | None:
    """Return the firmware version of a servo as a string; None if it is unknown."""
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
    listed = "; ".join(f"{model} {version}: {', '.join(ids)}" for (model, version), ids in sorted(versions.items()))
    cause = (
        f"Servos of the same model have different firmware versions ({listed}). servoloop works with all of them. "
        "Other programs may require a firmware update"
    )
    yield finding(
        "firmware_differs", FindingPlace(bus=bus.name), "other programs reject the firmware of the arm", cause
    )
