"""The whole of ``servoloop tune``: measured, better gains proposed, those that are wanted written, measured again."""

from collections.abc import Mapping

from commissioning.tune.law import Law
from commissioning.tune.propose import Proposal, propose
from commissioning.tune.report import Report
from commissioning.tune.tuner import Measurement, Tuner


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
