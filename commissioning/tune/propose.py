"""The proposal: which gains would be better, and why. One step at a time, for what shakes only a measurement shows."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from commissioning.tune.figures import Figures
from commissioning.tune.predict import Law, Predicted
from commissioning.tune.trial import Plan
from drivers.servos import sts
from hal.compensation.servo_compliance import STS_SETTINGS
from hal.joint import Joint

CALMER: Final = 0.75
"""Share of P that is left to a joint that shakes."""
LEAST_P: Final = 8
DEAD_ZONES: Final = ("cw_dead_zone", "ccw_dead_zone")
WIDE: Final = 3
"""A dead zone in which the least drive no longer throws a joint through its backlash."""
FACTORY_P: Final = STS_SETTINGS["position_p"]
"""More is not proposed: the gears' backlash is the same, and what load makes sag the stack compensates."""
STIFFER: Final = 1.5
"""At most so many times the present P at once."""
ALLOWED_REST_COUNTS: Final = 8.0
"""0.7 degrees: with less than that at rest a joint need not be stiffer."""
ALLOWED_OVERSHOOT: Final = 0.05
"""Of the step."""
WORTH_COUNTS: Final = 2.0
"""By so much less overshoot it must become, to be worth another D."""
D_STEP: Final = 4
MOST_D_TO_P: Final = 2.0
"""A servo looks at its error's change every 20 ms only: with more D it begins to chatter."""
UNKNOWN: Final = "its maker publishes neither its loop nor the scale of its gains: try some with --write, and compare"


@dataclass(frozen=True, slots=True)
class Proposal:
    """The gains to try, by name; none where the present ones are as good as the laws can say."""

    values: Mapping[str, int] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()
    predicted: Predicted | None = None
    """Of the values; None where there are none."""


def propose(joint: Joint, held: Mapping[str, int], plan: Plan, measured: Figures) -> Proposal:
    """The proposal for a joint that was measured with the gains ``held``; the joint as ``as_held`` makes it."""
    law = Law(joint, plan, measured)
    if not law.known:
        return Proposal(reasons=(UNKNOWN,))
    proposed = list(_changes(joint, held, plan, measured, law))
    values = {name: value for name, value, _ in proposed if value != held[name]}
    reasons = tuple(reason for _, _, reason in proposed)
    if not values:
        return Proposal(reasons=reasons or ("it rests, follows and overshoots as it should",))
    return Proposal(values, reasons, law.predict(values))


def _changes(
    joint: Joint, held: Mapping[str, int], plan: Plan, measured: Figures, law: Law
) -> Iterator[tuple[str, int, str]]:
    """Name, value and reason of each gain that is to change."""
    count = abs(joint.units_per_count)
    if measured.shakes:
        yield from _calmer(held, measured, count)
        return
    values = {name: STS_SETTINGS[name] for name in DEAD_ZONES if held.get(name, 0) > STS_SETTINGS[name]}
    for name, value in values.items():
        yield name, value, f"{name} {held[name]} leaves errors of {held[name]} counts alone; the factory has {value}"
    if stiffer := _stiffer(joint, held, measured, law, values):
        yield "P", *stiffer
        values["P"] = stiffer[0]
    if joint.model in sts.MODELS.values():
        yield from _damped(held, plan, measured, law, values, count)


def _calmer(held: Mapping[str, int], measured: Figures, count: float) -> Iterator[tuple[str, int, str]]:
    swing = f"it swings by {measured.swing / count:.0f} counts at rest ({measured.swing_hz:.1f} Hz)"
    if held.get("I"):
        yield "I", 0, f"{swing}: I {held['I']} adds up what friction holds, and throws it over"
    softer = max(round(CALMER * held["P"]), LEAST_P)
    if softer < held["P"]:
        yield "P", softer, f"{swing}: P is too high for its load and the backlash of its gears; a quarter less is tried"
        if held.get("cw_dead_zone", WIDE) < WIDE:
            yield "P", softer, f"dead_zone={WIDE} is another way: P stays, and it rests up to {WIDE} counts off"
    else:
        yield "P", held["P"], f"{swing}, and P is small: look for play in its horn and its gears"


def _stiffer(
    joint: Joint, held: Mapping[str, int], measured: Figures, law: Law, values: Mapping[str, int]
) -> tuple[int, str] | None:
    """A larger P for a joint that rests too far from its goals; not above an STS's factory value."""
    count, now = abs(joint.units_per_count), held["P"]
    most = min(round(STIFFER * now), FACTORY_P) if joint.model in sts.MODELS.values() else round(STIFFER * now)
    allowed = ALLOWED_REST_COUNTS * count
    if measured.rest_error <= allowed:
        return None
    off = f"it rests {measured.rest_error / count:.0f} counts off"
    if most <= now:
        return now, f"{off}: more P than the factory's is not proposed, the stack's gravity compensation takes that up"
    for wanted in range(now + 1, most + 1):
        rest = law.predict({**values, "P": wanted}).rest_error
        if rest is not None and rest <= allowed:
            break
    return wanted, f"{off}, and that goes as 1/P; it does not shake"


def _damped(
    held: Mapping[str, int], plan: Plan, measured: Figures, law: Law, values: Mapping[str, int], count: float
) -> Iterator[tuple[str, int, str]]:
    """The D with which it overshoots little enough, or least."""
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
