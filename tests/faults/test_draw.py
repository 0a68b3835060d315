"""Schedules are drawn before the run, and each kind of fault has its own random numbers."""

from collections import Counter
from contextlib import ExitStack
from dataclasses import replace
from math import log10
from random import Random
from typing import Any

import pytest

from drivers.servos.sts import STS3215
from hal.plausible import RANGES
from sim_backend.buses.feetech import VirtualBus
from sim_backend.faults.draw import draw
from sim_backend.faults.event import Event
from sim_backend.faults.events import KINDS
from sim_backend.faults.false_replies import FalsePosition
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.mechanics import Overload
from sim_backend.faults.player import require_possible
from sim_backend.faults.replies import FlippedReplies, LostReplies
from sim_backend.faults.servos import Hot
from sim_backend.faults.targets import FaultTargets, Inventory
from sim_backend.mechanics.plant import BenchPlant
from tests.faults.strategies import TWO_LINES


def test_a_seed_determines_one_possible_schedule() -> None:
    schedules = [draw(seed, TWO_LINES, 20.0, 30) for seed in range(10)]
    assert schedules == [draw(seed, TWO_LINES, 20.0, 30) for seed in range(10)]
    assert len(set(schedules)) == 10
    for schedule in schedules:
        assert len(schedule) == 30
        times = [(TWO_LINES.moments.index(event.since), event.at_s) for event in schedule]
        assert times == sorted(times)
        assert all(0.0 <= event.at_s <= 20.0 for event in schedule)
        require_possible(schedule, TWO_LINES)
    assert {event.kind for schedule in schedules for event in schedule} == set(KINDS)


def test_another_draw_within_one_kind_does_not_change_other_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    before = [draw(seed, TWO_LINES, 10.0, 30) for seed in range(10)]
    parameters = Hot.draw_parameters

    def one_more(random: Random, there: Inventory) -> dict[str, Any]:
        random.random()
        return parameters(random, there)

    monkeypatch.setattr(Hot, "draw_parameters", one_more)
    after = [draw(seed, TWO_LINES, 10.0, 30) for seed in range(10)]

    def others(schedules: list[tuple[Event, ...]]) -> list[list[Event]]:
        return [[event for event in schedule if event.kind != "hot"] for schedule in schedules]

    assert after != before
    assert others(after) == others(before)


def test_leaving_out_a_kind_only_makes_room_for_others() -> None:
    for seed in range(8):
        fewer = draw(seed, TWO_LINES, 10.0, 20, set(KINDS) - {"hot"})
        kept = [event for event in draw(seed, TWO_LINES, 10.0, 20) if event.kind != "hot"]
        assert set(kept) <= set(fewer)


def test_a_longer_schedule_contains_the_shorter_one() -> None:
    assert set(draw(3, TWO_LINES, 10.0, 5)) <= set(draw(3, TWO_LINES, 10.0, 25))


def test_only_requested_kinds_are_drawn() -> None:
    assert {event.kind for event in draw(1, TWO_LINES, 10.0, 9, ["silent", "noise"])} == {"silent", "noise"}
    with pytest.raises(FaultError, match="there is no fault 'sillent'"):
        draw(1, TWO_LINES, 10.0, 9, ["sillent"])


def test_impossible_faults_are_not_drawn() -> None:
    bare = Inventory({"": TWO_LINES.servos["the hand"]}, world=False, adapters=False, stack=False)
    drawn = {event.kind for seed in range(8) for event in draw(seed, bare, 10.0, 40)}
    missing = {"jammed", "overload", "overcurrent", "dead_encoder", "adapter_unplugged", "stall"}
    assert not drawn & missing
    assert "silent" in drawn


def test_other_faults_of_a_reply_do_not_change_the_next_reply() -> None:
    """Each event has its own random generator and takes one number for each reply."""

    def flipped(*others: Event) -> list[bytes]:
        line = VirtualBus.of(BenchPlant((1,)))
        with ExitStack() as acting:
            for event in (*others, FlippedReplies(chance=0.3, seed=5)):
                acting.enter_context(event.acting(FaultTargets({"": line})))
            return [line.faults.pass_reply(1, number.to_bytes(2, "big")) for number in range(500)]

    alone, beside = flipped(), flipped(LostReplies(chance=0.5, seed=5))
    assert beside.count(b"") > 100
    assert all(one in (b"", other) for one, other in zip(beside, alone, strict=True))
    assert 100 < sum(reply != number.to_bytes(2, "big") for number, reply in enumerate(alone)) < 200


def drawn(kind: str, parameter: str, there: Inventory = TWO_LINES) -> list[float]:
    """Return one parameter of many faults of one kind in ascending order, omitting faults without this parameter."""
    events = [event for seed in range(100) for event in draw(seed, there, 10.0, 10, [kind])]
    return sorted(value for event in events if (value := getattr(event, parameter)) is not None)


@pytest.mark.parametrize(
    ("kind", "parameter", "lowest", "highest"),
    [
        ("stall", "for_s", 0.001, 5.0),
        ("flipped_replies", "chance", 0.01, 1.0),
        ("missed_instructions", "chance", 0.01, 1.0),
        ("weak_supply", "resistance_ohm", 0.01, 20.0),
        ("overcurrent", "turns_left", 0.02, 0.99),
        ("foreign_packets", "every_s", 0.001, 1.0),
    ],
)
def test_each_power_of_ten_is_drawn_equally_often(kind: str, parameter: str, lowest: float, highest: float) -> None:
    values = drawn(kind, parameter)
    decades = log10(highest / lowest)
    assert lowest <= values[0] < lowest * 10 ** (0.1 * decades)
    assert highest >= values[-1] > highest / 10 ** (0.1 * decades)
    assert 0.4 * decades < log10(values[len(values) // 2] / lowest) < 0.6 * decades


def test_many_late_replies_are_late_by_several_cycles() -> None:
    delays_s = drawn("late_replies", "by_s")
    assert delays_s[0] < 0.0003 and delays_s[-1] > 0.9
    several = sum(0.1 <= delay_s <= 0.5 for delay_s in delays_s) / len(delays_s)
    assert 0.7 < several < 0.85  # SEVERAL_CYCLES, plus the fraction of the other delays within this range


def test_a_type_of_fault_with_a_weight_is_drawn_more_often() -> None:
    drawn_kinds = Counter(event.kind for seed in range(300) for event in draw(seed, TWO_LINES, 10.0, 3))
    assert 2.0 < drawn_kinds["late_replies"] / drawn_kinds["lost_replies"] < 4.0


def test_half_of_the_durations_are_near_the_time_outs() -> None:
    lengths_s = drawn("silent", "for_s")
    assert lengths_s[0] < 0.003 and lengths_s[-1] > 10.0
    usual = sum(0.05 <= length_s <= 2.0 for length_s in lengths_s) / len(lengths_s)
    assert 0.6 < usual < 0.75  # half of the durations, plus a fraction of the other half


@pytest.mark.parametrize(
    ("kind", "parameter", "usual"),
    [("weak_supply", "voltage_v", 12.0), ("hot", "temperature_c", 70.0), ("overload", "torque_nm", 3.0)],
)
def test_drawn_values_lie_on_both_sides_of_the_limit(kind: str, parameter: str, usual: float) -> None:
    servos = Inventory({"": TWO_LINES.servos["arm"]})
    sizes = sorted(abs(value) for value in drawn(kind, parameter, servos))
    assert sizes[0] < 0.5 * usual < 2.0 * usual < sizes[-1]


def test_the_torque_drawn_for_a_strong_servo_is_plausible() -> None:
    servos = Inventory({"": {1: replace(STS3215, stall_torque_nm=45.0)}})
    torques = [Overload.draw_parameters(Random(seed), servos)["torque_nm"] for seed in range(100)]
    assert max(abs(torque) for torque in torques) == RANGES["torque"].highest


@pytest.mark.parametrize("kind", ["overload", "slipped_horn", "false_position", "controller_jumps"])
def test_signed_parameters_are_drawn_with_both_signs(kind: str) -> None:
    name = {"overload": "torque_nm", "controller_jumps": "by_rad"}.get(kind, "counts")
    values = drawn(kind, name)
    sizes = sorted(abs(value) for value in values)
    assert 0.4 < sum(value < 0.0 for value in values) / len(values) < 0.6
    assert sizes[-1] > 50.0 * sizes[0]


def test_false_positions_are_single_repeated_and_lasting() -> None:
    events = [event for seed in range(100) for event in draw(seed, TWO_LINES, 10.0, 3, ["false_position"])]
    forms = Counter(
        "single" if event.replies == 1 else "each n-th" if event.every > 1 else "lasting"
        for event in events
        if isinstance(event, FalsePosition)
    )
    assert all(forms[form] > 0.15 * len(events) for form in ("single", "each n-th", "lasting"))
