"""Propose better gains and explain why. Changes are small, because only a measurement can show whether a joint
oscillates."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from commissioning.tune.figures import JointFigures
from commissioning.tune.predict import Law, Predicted
from commissioning.tune.trial import TrialPlan
from drivers.servos import sts
from hal.compensation.servo_compliance import STS_SETTINGS
from hal.joint import Joint

CALMER: Final = 0.75
"""New P of an oscillating joint, as a fraction of its present P."""
LEAST_P: Final = 8
DEAD_ZONES: Final = ("cw_dead_zone", "ccw_dead_zone")
WIDE: Final = 3
"""Dead zone that prevents the minimum drive from moving a joint through its backlash, in counts."""
FACTORY_P: Final = STS_SETTINGS["position_p"]
"""Largest P that is proposed for an STS. A larger P does not reduce backlash, and the stack already compensates sag."""
STIFFER: Final = 1.5
"""Maximum increase of P in one step, as a factor."""
ALLOWED_REST_COUNTS: Final = 8.0
"""Largest acceptable error at rest, in counts (0.7 degrees). A larger error requires a larger P."""
ALLOWED_OVERSHOOT: Final = 0.05
"""Acceptable overshoot, as a fraction of the step."""
WORTH_COUNTS: Final = 2.0
"""Minimum reduction of the overshoot for which a new D is proposed, in counts."""
D_STEP: Final = 4
MOST_D_TO_P: Final = 2.0
"""Maximum ratio of D to P. With a larger D, a servo chatters, because it computes the change of its error only every 20
ms.
"""
UNKNOWN: Final = (
    "no gains can be proposed, because the manufacturer does not publish how the gains work. Try different gains with "
    "--write and compare the results"
)


@dataclass(frozen=True, slots=True)
class Proposal:
    """Proposed gains and the reasons for them."""

    values: Mapping[str, int] = field(default_factory=dict)
    """Proposed gains, keyed by name; empty if no better gains are known."""
    reasons: tuple[str, ...] = ()
    predicted: Predicted | None = None
    """Performance figures predicted for the proposed gains; None if no prediction is available."""


def propose(joint: Joint, held: Mapping[str, int], plan: TrialPlan, measured: JointFigures) -> Proposal:
    """Return a proposal for a joint that was measured with the gains ``held``.

    ``joint`` must have the settings of its servo, as returned by ``as_held``.
    """
    law = Law(joint, plan, measured)
    if not law.known:
        return Proposal(reasons=(UNKNOWN,))
    proposed = list(_changes(joint, held, plan, measured, law))
    values = {name: value for name, value, _ in proposed if value != held[name]}
    reasons = tuple(reason for _, _, reason in proposed)
    if not values:
        return Proposal(reasons=reasons or ("its error at rest, its following error and its overshoot are good",))
    return Proposal(values, reasons, law.predict(values))


def _changes(
    joint: Joint, held: Mapping[str, int], plan: TrialPlan, measured: JointFigures, law: Law
) -> Iterator[tuple[str, int, str]]:
    """Yield the name, the new value and the reason for each gain to change."""
    count = abs(joint.units_per_count)
    if measured.shakes:
        yield from _calmer(held, measured, count)
        return
    values = {name: STS_SETTINGS[name] for name in DEAD_ZONES if held.get(name, 0) > STS_SETTINGS[name]}
    for name, value in values.items():
        yield (
            name,
            value,
            (
                f"with {name} {held[name]}, errors of up to {held[name]} counts are not corrected. The factory value "
                f"is {value}"
            ),
        )
    if stiffer := _stiffer(joint, held, measured, law, values):
        yield "P", *stiffer
        values["P"] = stiffer[0]
    if joint.model in sts.MODELS.values():
        yield from _damped(held, plan, measured, law, values, count)


def _calmer(held: Mapping[str, int], measured: JointFigures, count: float) -> Iterator[tuple[str, int, str]]:
    swing = f"it swings by {measured.swing / count:.0f} counts at rest ({measured.swing_hz:.1f} Hz)"
    if held.get("I"):
        yield "I", 0, f"{swing}, because I {held['I']} integrates the error from friction until the joint overshoots"
    softer = max(round(CALMER * held["P"]), LEAST_P)
    if softer < held["P"]:
        yield (
            "P",
            softer,
            f"{swing}, because P is too high for its load and the backlash of its gears; try a quarter less",
        )
        if held.get("cw_dead_zone", WIDE) < WIDE:
            yield (
                "P",
                softer,
                (f"alternatively keep P and set dead_zone={WIDE}; then errors of up to {WIDE} counts remain at rest"),
            )
    else:
        yield "P", held["P"], f"{swing}, although P is small: check its horn and its gears for play"


def _stiffer(
    joint: Joint, held: Mapping[str, int], measured: JointFigures, law: Law, values: Mapping[str, int]
) -> tuple[int, str] | None:
    """Return a larger P and the reason if the error at rest is too large. P is at most the factory value of an STS."""
    count, now = abs(joint.units_per_count), held["P"]
    most = min(round(STIFFER * now), FACTORY_P) if joint.model in sts.MODELS.values() else round(STIFFER * now)
    allowed = ALLOWED_REST_COUNTS * count
    if measured.rest_error <= allowed:
        return None
    off = f"its error at rest is {measured.rest_error / count:.0f} counts"
    if most <= now:
        return now, (
            f"{off}, but no P above the factory value is proposed: the gravity compensation of the stack corrects this "
            "error"
        )
    for wanted in range(now + 1, most + 1):
        rest = law.predict({**values, "P": wanted}).rest_error
        if rest is not None and rest <= allowed:
            break
    return wanted, f"{off}, which is proportional to 1/P, and it does not shake"


def _damped(
    held: Mapping[str, int], plan: TrialPlan, measured: JointFigures, law: Law, values: Mapping[str, int], count: float
) -> Iterator[tuple[str, int, str]]:
    """Yield the smallest D with an acceptable overshoot or, if there is none, the D with the smallest overshoot."""
    allowed, position_p = ALLOWED_OVERSHOOT * abs(plan.step), values.get("P", held["P"])
    now = law.predict(values).overshoot
    if now is None or now <= allowed or not law.weighed:
        return
    tried = {
        position_d: over
        for position_d in range(held["D"], round(MOST_D_TO_P * position_p) + 1, D_STEP)
        if (over := law.predict({**values, "D": position_d}).overshoot) is not None
    }
    enough = [position_d for position_d, over in tried.items() if over <= allowed]
    best = enough[0] if enough else min(tried, key=lambda position_d: tried[position_d], default=held["D"])
    if best != held["D"] and now - tried[best] >= WORTH_COUNTS * count:
        yield (
            "D",
            best,
            f"with P {position_p} it overshoots by {now / count:.0f} counts of {abs(plan.step) / count:.0f}",
        )
