"""Draw faults that rarely coincide by chance, such as two alarms of one servo or a push just before the end."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any, Final

from drivers.servos import x
from drivers.servos.voltage import voltage_range
from hal.joint import Joint
from servoloop.simulation.acts import Act, Move, Reactivate, SocketAct
from sim_backend.faults.event import Event
from sim_backend.faults.lines import AdapterUnplugged, WeakSupply
from sim_backend.faults.mechanics import Jammed, Overload
from sim_backend.faults.replies import LostReplies
from sim_backend.faults.servos import BEARABLE_C, BrownOut, HardwareError, Hot, Silent
from sim_backend.faults.tails import either_way, log_uniform

COINCIDES: Final = 0.25
"""Fraction of the runs with coinciding faults."""
COINCIDES_OFTEN: Final = 0.6
"""The same fraction of the runs with several buses, and of the runs whose client activates the hardware."""
NEAR_SEAM_COUNTS: Final = 120
"""Maximum distance from a joint limit to the seam of the encoder over which a person may push the joint, in counts."""
ARRIVES_S: Final = 2.5
"""Time that a joint needs to move to its limit, in seconds."""
RETURNS_S: Final = 2.0
"""Time that a joint needs to return to its limit after a push over its seam, in seconds."""

RELEASES_S: Final = 2.2
"""Time after which an overloaded STS servo releases its torque, in seconds."""


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """Properties of a run that are drawn before its coinciding faults."""

    joints: Sequence[Joint]
    """Joints of the arm that have servos."""
    acts: tuple[Act, ...]
    """Actions of the client."""
    end_s: float | None
    """Time at which the program begins to end, in seconds; None if jobs determine it."""
    within_s: float
    """Time within which faults begin, in seconds."""


Coincidence = tuple[tuple[Event, ...], tuple[Act, ...]]
"""Coinciding faults, and all actions of the client."""
Draw = Callable[[Random, DrawnRun], Coincidence | None]
"""Function that draws a coincidence, or None if it is impossible in this run."""


def draw_coincidence(seed: int, run: DrawnRun) -> Coincidence:
    """Return at most two faults that coincide, and the actions of the client.

    Args:
        seed: Seed of the run.
        run: Properties of the run.
    """
    random = Random(f"{seed}/coincidence")
    activates = any(isinstance(act, Reactivate) for act in run.acts)
    several = len({joint.bus for joint in run.joints}) > 1
    if random.random() >= (COINCIDES_OFTEN if activates or several else COINCIDES):
        return (), run.acts
    draws = ACTIVATIONS if activates else COINCIDENCES
    draw = _lost_adapter_of_one_bus if several and random.random() < 0.5 else random.choice(draws)
    return draw(random, run) or ((), run.acts)


def _two_alarms(random: Random, run: DrawnRun) -> Coincidence:
    """Heat a servo while its supply has the wrong voltage."""
    joint, at_s, for_s = random.choice(run.joints), random.uniform(0.0, run.within_s), random.uniform(1.0, 5.0)
    lowest, highest = voltage_range(joint.model)
    voltage_v = random.choice([0.95 * lowest, 1.1 * highest])
    temperature_c = BEARABLE_C * random.uniform(1.05, 1.4)
    hot = Hot(at_s=_ms(at_s), temperature_c=round(temperature_c, 1), for_s=_ms(for_s), **_servo(joint))
    supply_s = max(at_s - random.uniform(0.0, 0.5), 0.0)
    supply = WeakSupply(at_s=_ms(supply_s), voltage_v=round(voltage_v, 2), for_s=_ms(for_s), bus=joint.bus or None)
    return (supply, hot), run.acts


def _lost_adapter_at_the_end(random: Random, run: DrawnRun) -> Coincidence:
    """Unplug an adapter around the end, plug it in again, and disturb or push one of its joints."""
    joint, for_s = random.choice(run.joints), log_uniform(random, 0.02, 1.0)
    if run.end_s is None or random.random() < 0.5:
        since, at_s = "end", random.uniform(0.0, 0.15)
    else:
        since, at_s = "up", max(run.end_s - for_s - random.uniform(0.0, 0.1), 0.0)
    when = {"since": since, "at_s": _ms(at_s)}
    unplugged = AdapterUnplugged.model_validate({**when, "for_s": for_s, "bus": joint.bus or None})
    which = random.choice(["silent", "reset", "pushed"])
    if which == "silent":
        return (unplugged, Silent.model_validate({**when, **_servo(joint)})), run.acts
    if which == "reset":
        return (unplugged, BrownOut.model_validate({**when, **_servo(joint), "boot_s": 0.02})), run.acts
    torque_nm = either_way(random, round(joint.model.stall_torque_nm * random.uniform(1.2, 3.0), 2))
    return (unplugged, Overload.model_validate({**when, **_servo(joint), "torque_nm": torque_nm})), run.acts


def _lost_adapter_of_one_bus(random: Random, run: DrawnRun) -> Coincidence:
    """Unplug one of several adapters soon after the client has begun to move the arm."""
    begin_s = random.choice(run.acts).at_s if run.acts else random.uniform(0.0, run.within_s)
    at_s, bus = min(begin_s + random.uniform(0.0, 1.0), run.within_s), random.choice(run.joints).bus
    return (AdapterUnplugged(at_s=_ms(at_s), bus=bus, for_s=log_uniform(random, 0.2, 5.0)),), run.acts


def _pushed_at_the_end(random: Random, run: DrawnRun) -> Coincidence:
    """Push a joint with more than its own torque just before or while the program ends."""
    joint, for_s = random.choice(run.joints), random.uniform(0.2, 1.5)
    if run.end_s is None or random.random() < 0.5:
        since, at_s = "end", random.uniform(0.0, 0.5)
    else:
        since, at_s = "up", max(run.end_s - random.uniform(0.05, 0.8), 0.0)
    torque_nm = either_way(random, joint.model.stall_torque_nm * random.uniform(1.2, 3.0))
    push = {"since": since, "at_s": _ms(at_s), "for_s": _ms(for_s), "torque_nm": round(torque_nm, 2)}
    return (Overload.model_validate({**push, **_servo(joint)}),), run.acts


def _jammed_before_the_end(random: Random, run: DrawnRun) -> Coincidence | None:
    """Jam the gears of a joint so that its motion presses when the program begins to end."""
    if run.end_s is None:
        return None
    at_s = max(run.end_s - random.uniform(0.05, 1.5), 0.0)
    return (Jammed(at_s=_ms(at_s), **_servo(random.choice(run.joints))),), run.acts


def _pushed_over_a_seam(random: Random, run: DrawnRun) -> Coincidence | None:
    """Move a joint to a limit near the seam of its encoder, push it over the seam, and let it return."""
    ends = [(joint, end) for joint in run.joints for end in _ends_near_a_seam(joint)]
    latest_s = (run.end_s or 0.0) - ARRIVES_S - RETURNS_S
    if not ends or latest_s < 0.0 or any(isinstance(act, SocketAct) for act in run.acts):
        return None
    (joint, end), at_s = random.choice(ends), random.uniform(0.0, latest_s)
    move = Move(at_s=_ms(at_s), positions={joint.name: end}, seconds=ARRIVES_S - 0.5)
    torque_nm = joint.model.stall_torque_nm * random.uniform(3.0, 6.0) * (1.0 if end == joint.limits.upper else -1.0)
    for_s = random.uniform(0.2, 0.8)
    push = Overload(at_s=_ms(at_s + ARRIVES_S), for_s=_ms(for_s), torque_nm=round(torque_nm, 2), **_servo(joint))
    others = (act for act in run.acts if not at_s <= act.at_s < at_s + ARRIVES_S + RETURNS_S)
    return (push,), tuple(sorted((*others, move), key=lambda act: act.at_s))


def _ends_near_a_seam(joint: Joint) -> list[float]:
    """Return the limits of a joint that are near the seam of its encoder, in rad or m."""
    if joint.seam_inside or joint.model.positions is not None or joint.extended:
        return []
    far = joint.model.counts_per_turn - NEAR_SEAM_COUNTS
    return [end for end in (joint.limits.lower, joint.limits.upper) if not NEAR_SEAM_COUNTS < joint.counts(end) < far]


def _alarm_before_an_activation(random: Random, run: DrawnRun) -> Coincidence:
    """Make a servo release its torque with an alarm before the client activates it again."""
    joint, activations = random.choice(run.joints), [act for act in run.acts if isinstance(act, Reactivate)]
    act = random.choice([act for act in activations if act.for_s == 0.0] or activations)
    at_s = max(act.at_s - random.uniform(0.0, 2.0), 0.0)
    when = {"at_s": _ms(min(at_s, max(run.within_s - RELEASES_S, 0.0))), **_servo(joint)}
    if joint.model in x.MODELS.values():  # such an alarm ends only when the servo restarts
        restart_s = _ms(when["at_s"] + random.uniform(0.1, 1.0))
        return (HardwareError(**when), BrownOut(**when | {"at_s": min(restart_s, run.within_s)})), run.acts
    if random.random() < 0.5:
        temperature_c, for_s = round(BEARABLE_C * random.uniform(1.05, 1.3), 1), _ms(random.uniform(0.3, 3.0))
        return (Hot(temperature_c=temperature_c, for_s=for_s, **when),), run.acts
    torque_nm = either_way(random, round(joint.model.stall_torque_nm * random.uniform(1.5, 4.0), 2))
    return (Overload(torque_nm=torque_nm, for_s=_ms(RELEASES_S + random.uniform(0.0, 1.5)), **when),), run.acts


def _lost_replies_at_an_activation(random: Random, run: DrawnRun) -> Coincidence:
    """Lose replies while the client activates a servo, if necessary after this servo has lost its power."""
    joint, act = random.choice(run.joints), random.choice([act for act in run.acts if isinstance(act, Reactivate)])
    chance = random.choice([1.0, round(random.uniform(0.2, 1.0), 2)])
    begins_s = max(act.at_s + (act.for_s + random.uniform(-0.05, 0.15) if act.for_s else random.uniform(0.3, 0.9)), 0.0)
    parameters = {"chance": chance, "seed": random.randrange(1 << 16), "for_s": log_uniform(random, 0.02, 1.0)}
    lost = LostReplies.model_validate({"at_s": _ms(begins_s), **parameters, **_servo(joint)})
    dark = BrownOut(at_s=act.at_s, boot_s=0.02, **_servo(random.choice(run.joints)))
    return ((lost,) if act.for_s else (dark, lost)), run.acts


def _servo(joint: Joint) -> dict[str, Any]:
    return {"servo_id": joint.servo_id, "bus": joint.bus or None}


def _ms(time_s: float) -> float:
    return round(time_s, 3)


COINCIDENCES: Final[tuple[Draw, ...]] = (
    _two_alarms,
    _lost_adapter_at_the_end,
    _pushed_at_the_end,
    _jammed_before_the_end,
    *[_pushed_over_a_seam] * 3,
)
"""Coincidences of a run whose client does not activate the hardware. Few joints can be pushed over a seam."""
ACTIVATIONS: Final[tuple[Draw, ...]] = (
    *[_alarm_before_an_activation] * 2,
    _lost_replies_at_an_activation,
    _two_alarms,
)
"""Coincidences of a run whose client activates the hardware."""
