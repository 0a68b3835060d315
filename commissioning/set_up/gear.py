"""Gears are told apart by the drive that a speed needs: some models say the same number, and differ in nothing else."""

from dataclasses import dataclass
from math import log
from typing import Final, Literal

from commissioning.drive_trial import STUCK_SHARE, JointMotion
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel

GEARS: Final = {sts.STS3215: 345, sts.STS3215_C001: 345, sts.STS3215_C044: 191, sts.STS3215_C046: 147}
"""Turns of the motor in one of the shaft, by the makers' data sheets, of models that say one number."""
FITS: Final = 0.22
"""Natural logarithm of measured by expected: motors of one model differ by up to a tenth, a cold one needs more."""
CLEARLY: Final = 0.06
"""The same: by so much nearer to one model than to the next."""
PULLS: Final = 0.1
"""Of full drive: a loose horn has nothing that pulls at it one way."""

Verdict = Literal["fits", "other", "not sure"]


@dataclass(frozen=True, slots=True)
class GearLook:
    """What a turn of a loose servo has shown of its gear; ``text`` for people."""

    verdict: Verdict
    text: str
    v_s_rad: float | None = None
    """The voltage that a rad/s of its shaft needs, friction aside."""


def rivals(model: ServoModel) -> tuple[ServoModel, ...]:
    """The models of its series that say the same number."""
    return tuple(one for one in series_of(model).models if one.number == model.number and one != model)


def v_s_rad(model: ServoModel) -> float:
    """The voltage that a rad/s of the model's shaft needs, by its data sheet."""
    return model.rated_voltage_v / model.no_load_speed_rad_s


def called(model: ServoModel) -> str:
    """The model's name with that in which those of its number differ."""
    gear = f", gear 1:{GEARS[model]}" if model in GEARS else ""
    return f"{model.name} ({model.rated_voltage_v:g} V{gear})"


def judge_gear(motion: JointMotion | None) -> GearLook:
    """Whether a servo that turned loosely is of its joint's model, as far as its drive tells. None: it has no room."""
    if motion is None:
        return GearLook("not sure", "it stands too near to its position limits to turn")
    model, faster = motion.joint.model, motion.faster
    if motion.moved / motion.asked < STUCK_SHARE or faster is None:
        return GearLook("not sure", "its horn did not follow: it is not free, or has no force")
    measured = round(v_s_rad(model) / faster, 3)
    if abs(motion.pull) > PULLS:
        return GearLook("not sure", "something pulls at its horn", measured)
    off = {one: abs(log(measured / v_s_rad(one))) for one in (model, *rivals(model))}
    nearest = min(off.values())
    needs = f"a rad/s needs {measured:.2f} V, and {v_s_rad(model):.2f} V in a {called(model)}"
    if nearest > FITS:
        return GearLook("not sure", f"{needs}: no model that is known", measured)
    seems = sorted((one for one in off if off[one] - nearest < CLEARLY), key=v_s_rad)
    said = " or a ".join(called(one) for one in seems)
    if model not in seems:
        return GearLook("other", f"{needs}: it seems to be a {said}", measured)
    return (
        GearLook("fits", needs, measured) if seems == [model] else GearLook("not sure", f"{needs}: a {said}", measured)
    )
