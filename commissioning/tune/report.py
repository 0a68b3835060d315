"""The report of a tuning: both measurements, what was proposed and written, and what to put into the robot file."""

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


@dataclass(frozen=True, slots=True)
class Report:
    """The tuning of one joint."""

    joint: Joint
    before: Measurement
    proposal: Proposal
    predicted: Predicted | None
    """Of what was written, or else of what is proposed."""
    named: Mapping[str, int]
    """The settings that the robot file names for this joint."""
    written: tuple[Written, ...] = ()
    after: Measurement | None = None

    def completed(self, written: tuple[Written, ...], after: Measurement) -> "Report":
        """The report once gains were written and measured."""
        return replace(self, written=written, after=after)

    @property
    def unit(self) -> str:
        """The joint's: rad or m."""
        return "rad" if self.joint.transmission == 1.0 else "m"

    @property
    def count(self) -> float:
        """One of the encoder's, rad or m."""
        return abs(self.joint.units_per_count)

    @property
    def held(self) -> Mapping[str, int]:
        """The gains that the servo has now, by name."""
        return (self.after or self.before).gains

    @property
    def to_keep(self) -> dict[str, Any]:
        """The joint's words in the robot file with which the stack keeps what was written."""
        return kept(self.joint.model, {one.gain: one.new for one in self.written}, self.named)

    @property
    def overruled(self) -> dict[str, int]:
        """Settings in the robot file that are others than the servo's now: ``servoloop up`` writes them back."""
        known = gains_of(self.joint.model)
        now = {known[name].name: value for name, value in self.held.items()}
        return {name: value for name, value in self.named.items() if now.get(name, value) != value}

    def as_dict(self) -> dict[str, Any]:
        """For programs. Positions in rad or m, times in s."""
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
    """A joint's words in the robot file for these gains (by name), beside the settings ``named`` there.

    A Dynamixel's I and D live in RAM, and no robot file names them.
    """
    known = gains_of(model)
    settings = {known[name].name: value for name, value in values.items() if known[name].persistent}
    found: dict[str, Any] = {"settings": {**named, **settings}} if settings else {}
    if "P" in values and series_of(model).position_p is not None:
        found["position_p"] = values["P"]
    return found


def tune(tuner: Tuner, at: float | None = None, write: Mapping[str, int] | None = None, apply: bool = False) -> Report:
    """Measure the tuner's joint and propose gains; write those of ``write``, or with ``apply`` the proposed ones.

    ``at``: where to measure, rad or m. Where gains were written it is measured once more. Nothing is written that the
    servo holds already. Raises TuneError, DriverError, HalError; what had been written stands in their notes.
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
    report = Report(joint, before, proposal, predicted, tuner.named)
    if not values:
        return report
    written = tuner.write(values)
    try:
        after = tuner.measure(at)
    except BaseException as error:
        for one in written:
            error.add_note(f"written before that: {one.gain} {one.old} to {one.new} (servo {joint.servo_id})")
        raise
    return report.completed(written, after)


def _chosen(found: Measurement, proposal: Proposal, write: Mapping[str, int] | None, apply: bool) -> dict[str, int]:
    """The gains to be written: what was asked for, and the servo has otherwise."""
    wanted = write or (proposal.values if apply else {})
    return {name: value for name, value in wanted.items() if found.gains[name] != value}
