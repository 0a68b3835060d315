"""Schedules are drawn up front, each kind from its own numbers."""

from contextlib import ExitStack
from random import Random
from typing import Any

import pytest

from sim_backend.faults.draw import draw
from sim_backend.faults.errors import FaultError
from sim_backend.faults.event import Event
from sim_backend.faults.events import KINDS
from sim_backend.faults.player import require_possible
from sim_backend.faults.replies import FlippedReplies, LostReplies
from sim_backend.faults.servos import Hot
from sim_backend.faults.targets import Inventory, Targets
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.wire.bus import VirtualBus
from tests.faults.strategies import TWO_LINES


def test_a_seed_gives_one_schedule_that_is_possible() -> None:
    schedules = [draw(seed, TWO_LINES, 20.0, 30) for seed in range(10)]
    assert schedules == [draw(seed, TWO_LINES, 20.0, 30) for seed in range(10)]
    assert len(set(schedules)) == 10
    for schedule in schedules:
        assert len(schedule) == 30
        assert [event.at_s for event in schedule] == sorted(event.at_s for event in schedule)
        assert all(0.0 <= event.at_s <= 20.0 for event in schedule)
        require_possible(schedule, TWO_LINES)
    assert {event.kind for schedule in schedules for event in schedule} == set(KINDS)


def test_one_more_number_in_a_kind_changes_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_kind_less_only_makes_room() -> None:
    for seed in range(20):
        fewer = draw(seed, TWO_LINES, 10.0, 20, set(KINDS) - {"hot"})
        kept = [event for event in draw(seed, TWO_LINES, 10.0, 20) if event.kind != "hot"]
        assert set(kept) <= set(fewer)


def test_more_faults_are_those_and_more() -> None:
    assert set(draw(3, TWO_LINES, 10.0, 5)) <= set(draw(3, TWO_LINES, 10.0, 25))


def test_only_the_kinds_that_are_asked_for_are_drawn() -> None:
    assert {event.kind for event in draw(1, TWO_LINES, 10.0, 9, ["silent", "noise"])} == {"silent", "noise"}
    with pytest.raises(FaultError, match="there is no fault 'sillent'"):
        draw(1, TWO_LINES, 10.0, 9, ["sillent"])


def test_what_nothing_there_can_have_is_not_drawn() -> None:
    bare = Inventory({"": TWO_LINES.servos["the hand"]}, world=False, adapters=False, stack=False)
    drawn = {event.kind for seed in range(20) for event in draw(seed, bare, 10.0, 40)}
    missing = {"jammed", "overload", "overcurrent", "dead_encoder", "adapter_unplugged", "stall"}
    assert not drawn & missing
    assert "silent" in drawn


def test_what_is_left_of_a_reply_changes_nothing_of_what_happens_to_the_next() -> None:
    """Each event has its own numbers, and takes one for each reply."""

    def flipped(*others: Event) -> list[bytes]:
        line = VirtualBus.of(BenchPlant((1,)))
        with ExitStack() as acting:
            for event in (*others, FlippedReplies(chance=0.3, seed=5)):
                acting.enter_context(event.acting(Targets({"": line})))
            return [line.faults.pass_reply(1, number.to_bytes(2, "big")) for number in range(500)]

    alone, beside = flipped(), flipped(LostReplies(chance=0.5, seed=5))
    assert beside.count(b"") > 100
    assert all(one in (b"", other) for one, other in zip(beside, alone, strict=True))
    assert 100 < sum(reply != number.to_bytes(2, "big") for number, reply in enumerate(alone)) < 200
