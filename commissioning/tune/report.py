"""Tune one joint, and report the measurements, the proposed and written gains, and the lines for the robot file."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from commissioning.tune.gains import Written, gains_of
from commissioning.tune.predict import Law, Predicted
from commissioning.tune.propose import Proposal, propose
from commissioning.tune.tuner import Measurement, Tuner
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from hal.joint import Joint
from hal.servos.servo_settings import settings_of


@dataclass(frozen=True, slots=True)
class TuneReport:
    """Tuning result for one joint."""

    joint: Joint
    before: Measurement
    proposal: Proposal
    predicted: Predicted | None
    """Performance figures predicted for the written gains, or for the proposed gains if none were written."""
    named: Mapping[str, int]
    """Settings of this joint in the robot file."""
    written: tuple[Written, ...] = ()
    after: Measurement | None = None
    """Measurement with the written gains; None if no gains were written."""

    def completed(self, written: tuple[Written, ...], after: Measurement) -> "TuneReport":
        """Return the report with the written gains and the new measurement."""
        return replace(self, written=written, after=after)

    @property
    def unit(self) -> str:
        """Unit of the joint position: rad or m."""
        return self.joint.unit

    @property
    def count(self) -> float:
        """Size of an encoder count, in rad or m."""
        return abs(self.joint.units_per_count)

    @property
    def held(self) -> Mapping[str, int]:
        """Present gains of the servo, keyed by name."""
        return (self.after or self.before).gains

    @property
    def to_keep(self) -> dict[str, Any]:
        """Robot file entries for the joint that make the stack keep the written gains."""
        return kept(self.joint.model, {one.gain: one.new for one in self.written}, self.named)

    @property
    def overruled(self) -> dict[str, int]:
        """Settings in the robot file that differ from those in the servo.

        ``servoloop up`` will write these settings to the servo.
        """
        known = gains_of(self.joint.model)
        now = {known[name].name: value for name, value in self.held.items()}
        return {name: value for name, value in self.named.items() if now.get(name, value) != value}

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a dictionary for JSON. Positions are in rad or m, times in seconds."""
        return {
            "joint": self.joint.name,
            "servo_id": self.joint.servo_id,
            "model": self.joint.model.name,
            "unit": self.unit,
            "count": self.count,
            "plan": asdict(self.before.plan),
            "before": _plain(self.before),
            "proposal": asdict(self.proposal),
            "predicted": None if self.predicted is None else asdict(self.predicted),
            "written": [asdict(one) for one in self.written],
            "after": None if self.after is None else _plain(self.after),
            "robot_file": self.to_keep,
            "overruled": self.overruled,
        }


def _plain(found: Measurement) -> dict[str, Any]:
    return {"gains": dict(found.gains), "figures": asdict(found.figures)}


def kept(model: ServoModel, values: Mapping[str, int], named: Mapping[str, int]) -> dict[str, Any]:
    """Return the robot file entries for a joint that set these gains, in addition to the settings in ``named``."""
    known, stored = gains_of(model), settings_of(model)
    settings = {known[name].name: value for name, value in values.items() if known[name].name in stored}
    found: dict[str, Any] = {"settings": {**named, **settings}} if settings else {}
    if "P" in values and series_of(model).position_p is not None:
        found["position_p"] = values["P"]
    return found


def tune(
    tuner: Tuner, at: float | None = None, write: Mapping[str, int] | None = None, apply: bool = False
) -> TuneReport:
    """Measure a joint, propose gains, and optionally write gains and measure again.

    Args:
        tuner: Tuner of the joint.
        at: Position at which to measure, in rad or m; if None, a position near the present one is used.
        write: Gains to write, keyed by name.
        apply: Whether to write the proposed gains if ``write`` is empty.

    Raises:
        TuneError, DriverError, HalError: Tuning failed. Notes on the exception list the gains that were already
            written.
    """
    tuner.check_write(bool(write or apply))
    joint = tuner.joint
    proposals: list[Proposal] = []

    def again(found: Measurement) -> bool:
        proposals.append(propose(joint, found.gains, found.plan, found.figures))
        return bool(_chosen(found, proposals[0], write, apply))

    before = tuner.measure(at, again)
    (proposal,) = proposals
    values = _chosen(before, proposal, write, apply)
    law = Law(joint, before.plan, before.figures)
    predicted = law.predict(values) if values else proposal.predicted
    report = TuneReport(joint, before, proposal, predicted, tuner.named)
    if not values:
        return report
    written = tuner.write(values)
    try:
        after = tuner.measure(at)
    except BaseException as error:
        for one in written:
            error.add_note(f"already written to servo {joint.servo_id}: {one.gain} changed from {one.old} to {one.new}")
        raise
    return report.completed(written, after)


def _chosen(found: Measurement, proposal: Proposal, write: Mapping[str, int] | None, apply: bool) -> dict[str, int]:
    """Return the requested gains that differ from those in the servo."""
    wanted = write or (proposal.values if apply else {})
    return {name: value for name, value in wanted.items() if found.gains[name] != value}
