"""A campaign finds safety gates and drivers that are broken on purpose, and minimizes the schedules."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from drivers.bus.bus import Bus
from drivers.protocol import v1
from drivers.protocol.decoder import Reply
from drivers.types import Reading, ServoFault, ServoGoal, ServoState
from hal.gate import Gated, SafetyGate
from hal.servos.activation import Activation
from hal.types import FloatArray
from servoloop.campaign.campaign import run_schedule_of, run_seed
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.shrink import shrink
from servoloop.simulation.schedule import Schedule

SEEDS = 1000
SCENARIO = Scenario(seconds=1.5, faults=4, within_s=1.2)
"""Scenario with all kinds of faults that the arm supports, without any hint about the bug."""
MOVING = Scenario(job=("A",), faults=4, within_s=5.0)
"""Scenario for bugs that have no effect on an arm at rest."""
Break = Callable[[pytest.MonkeyPatch], None]
limit = SafetyGate.limit


def gate(broken: Callable[..., FloatArray]) -> Break:
    """Return a bug whose gate returns ``broken(gate, wanted, last command, correct output)``."""

    def wrong(gate: SafetyGate, wanted: FloatArray, last: FloatArray, period_s: float, *more: Any) -> Gated:
        return Gated(broken(gate, wanted, last, limit(gate, wanted, last, period_s, *more).values, period_s), {})

    return lambda patch: patch.setattr(SafetyGate, "limit", wrong)


def passes_everything(gate: Any, wanted: FloatArray, *_: Any) -> FloatArray:
    return wanted


def passes_nan(gate: Any, wanted: FloatArray, last: FloatArray, safe: FloatArray, _: float) -> FloatArray:
    return np.where(np.isnan(wanted), wanted, safe)


def knows_no_steps(gate: Any, wanted: FloatArray, last: FloatArray, safe: FloatArray, _: float) -> FloatArray:
    return np.clip(np.where(np.isfinite(wanted), wanted, last), gate._lower, gate._upper)


def knows_no_ends(gate: Any, wanted: FloatArray, last: FloatArray, safe: FloatArray, period_s: float) -> FloatArray:
    reach = gate._rate * period_s
    return np.clip(np.where(np.isfinite(wanted), wanted, last), last - reach, last + reach)


def allows_twice_the_way(gate: Any, wanted: FloatArray, last: FloatArray, _: Any, period_s: float) -> FloatArray:
    return limit(gate, wanted, last, 2.0 * period_s).values


def takes_the_limits_of_the_joint_before(gate: Any, wanted: FloatArray, last: FloatArray, *_: Any) -> FloatArray:
    period_s = _[-1]
    reach = gate._rate * period_s
    ends = np.roll(gate._lower, 1), np.roll(gate._upper, 1)
    return np.clip(np.clip(np.where(np.isfinite(wanted), wanted, last), *ends), last - reach, last + reach)


def takes_any_checksum(patch: pytest.MonkeyPatch) -> None:
    """A corrupt reply is accepted."""

    def decode(self: Any, pending: bytes, at: int, replies: list[Reply]) -> int | None:
        frame = pending[at : at + self.data_size + v1.OVERHEAD]
        if len(frame) < self.data_size + v1.OVERHEAD:
            return None
        return self._accept(Reply(frame[2], frame[4], frame[5:-1], self.garbage), len(frame), replies)

    patch.setattr(v1.ReplyDecoder, "_decode", decode)


def invents_who_is_silent(patch: pytest.MonkeyPatch) -> None:
    """A silent servo keeps its last position, and its silence is not reported."""
    receive, known = Bus.receive, dict[int, ServoState]()

    def wrong(bus: Bus) -> Mapping[int, Reading]:
        readings = receive(bus)
        known.update({i: state for i, state in readings.items() if isinstance(state, ServoState)})
        return {i: known.get(i, reading) for i, reading in readings.items()}

    patch.setattr(Bus, "receive", wrong)


def gives_up_on_all(patch: pytest.MonkeyPatch) -> None:
    """One silent servo ends the reading of the servos after it."""
    receive = Bus.receive

    def wrong(bus: Bus) -> Mapping[int, Reading]:
        readings = receive(bus)
        fault = next((one for one in readings.values() if isinstance(one, ServoFault)), None)
        return readings if fault is None else dict.fromkeys(readings, fault)

    patch.setattr(Bus, "receive", wrong)


def tells_the_next_servo(patch: pytest.MonkeyPatch) -> None:
    """Each goal is sent to the next servo."""
    write_goals = Bus.write_goals

    def wrong(bus: Bus, goals: Mapping[int, ServoGoal]) -> None:
        ids = list(goals)
        write_goals(bus, dict(zip(ids[1:] + ids[:1], goals.values(), strict=True)))

    patch.setattr(Bus, "write_goals", wrong)


def believes_in_torque(patch: pytest.MonkeyPatch) -> None:
    """A servo that has lost its torque is assumed to have torque enabled."""

    def wrong(bus: Bus, servo_ids: Sequence[int], deadline_s: float) -> dict[int, bool]:
        return dict.fromkeys(servo_ids, True)

    patch.setattr(Bus, "torque_states", wrong)


def switches_on_first(patch: pytest.MonkeyPatch) -> None:
    """Torque is enabled before the goals equal the measured positions."""
    patch.setattr(Activation, "_hold_goals", lambda activation: None)
    patch.setattr(Activation, "_confirm_goal", lambda activation, joint: None)


GATES: dict[str, Break] = {
    broken.__name__: gate(broken)
    for broken in (
        passes_everything,
        passes_nan,
        knows_no_steps,
        knows_no_ends,
        allows_twice_the_way,
        takes_the_limits_of_the_joint_before,
    )
}
DRIVERS: dict[str, Break] = {
    broken.__name__: broken
    for broken in (
        takes_any_checksum,
        invents_who_is_silent,
        gives_up_on_all,
        tells_the_next_servo,
        believes_in_torque,
        switches_on_first,
    )
}
FOUND_BY = {
    **dict.fromkeys(GATES, "safe commands"),
    "takes_any_checksum": "measured now",
    "invents_who_is_silent": "silent servo is reported",
    "gives_up_on_all": "silent servo is reported",
    "tells_the_next_servo": "safe wire",
    "believes_in_torque": "safe wire",
    "switches_on_first": "safe wire",
}


LATE = {
    "takes_the_limits_of_the_joint_before": 80,
    "believes_in_torque": 20,
    "knows_no_ends": 25,
    "invents_who_is_silent": 120,
}
"""First seeds for campaigns that would otherwise search for a long time."""


def first_that_breaks(invariant: str, scenario: Scenario, first: int) -> Schedule:
    for seed in range(first, SEEDS):
        report = run_seed(scenario, seed)
        if any(one.invariant == invariant for one in report.violations):
            return report.schedule
    raise AssertionError(f"in {SEEDS} seeds nothing broke {invariant!r}")


@pytest.mark.slow
@pytest.mark.parametrize("name", [*GATES, *DRIVERS])
def test_a_campaign_finds_the_broken_layer_and_minimizes_the_schedule(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (GATES | DRIVERS)[name](monkeypatch)
    invariant = FOUND_BY[name]

    def breaks(schedule: Schedule) -> bool:
        return any(one.invariant == invariant for one in run_schedule_of(schedule).violations)

    scenario = MOVING if name == "believes_in_torque" else SCENARIO
    smallest = shrink(first_that_breaks(invariant, scenario, LATE.get(name, 0)), breaks)
    assert len(smallest.faults) <= 3
    monkeypatch.undo()
    assert run_schedule_of(smallest).violations == (), "falls with whole layers too"
