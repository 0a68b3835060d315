"""Who is asked when: all in one question, those that are missing again, and those that are silent last."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from drivers.absent import AbsenceWatch
from drivers.burst import BITS_PER_BYTE, TRIED_GAP_S
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.dynamixel import wire
from drivers.dynamixel.burst import BurstReader
from drivers.dynamixel.models import X
from drivers.dynamixel.series import StateBlock
from drivers.port import Port
from drivers.readings import RETRIES, Outcome, count_skipped


class Turn(NamedTuple):
    """A question that has been sent: to whom, of them who surely answers, and who is only tried."""

    asked: tuple[int, ...]
    firm: tuple[int, ...]
    tried: tuple[int, ...]


class StateReader:
    """The group reads of one bus. Raises only PortLost."""

    def __init__(self, port: Port, clock: Clock, burst: BurstReader, counters: BusCounters) -> None:
        self._port = port
        self._clock = clock
        self._burst = burst
        self._counters = counters
        self._fast_tried = False
        self._absent = AbsenceWatch()
        self._queue: list[int] = []  # of those that did not answer last time, in the order to try them
        self._first: Mapping[int, StateBlock] = {}  # what the last cycle asked for at first
        self.missed: set[int] = set()
        """Who gave no state to the first question of the last cycle."""

    def read(self, asked: tuple[int, ...]) -> dict[int, Outcome]:
        """Ask without a deadline, waiting for everybody: not for a cycle."""
        # Whether a servo waits in vain for one before it that is silent, the manual does not say. So those
        # that were missing are asked last, and whoever may have waited in vain is asked once more.
        firm, tried = self._absent.split(asked, math.inf)
        self.missed.clear()
        outcome = dict(self._burst.read(firm + self._queued(tried), (), math.inf)) if asked else {}
        behind = tuple(i for i in _worth_asking(self._note(outcome)[:-1], outcome) if i in firm)
        if behind:
            for servo_id in behind:
                self._counters.of(servo_id).retries += 1
            again = self._burst.read(behind, (), math.inf)
            self._note(again)
            outcome.update(again)
        if asked and not self._fast_tried and not self._absent.misses and self._burst.clean:
            self._try_fast(asked)
        return outcome

    def _try_fast(self, servo_ids: tuple[int, ...]) -> None:
        """Once a bus, when all have just answered, and outside of a cycle: can they be read fast?"""
        if self._burst.plans.fast(servo_ids) is None:
            return
        self._fast_tried = True
        self._burst.try_fast(servo_ids)

    def ask(self, asked: tuple[int, ...], goals: bytes, deadline_s: float) -> Turn:
        """Send the goals and the question."""
        firm, tried = self._absent.split(asked, self._clock.now())
        tried = self._queued(tried)
        # Not while somebody is missing: one who is silent would hide those behind it.
        fast_until_s = deadline_s if firm and not tried else -math.inf
        if not firm:
            # Where nobody is expected to answer, the adapter may be the slow one: the whole first wait.
            firm, tried = tried, ()
        if firm:
            self._burst.ask(firm, tried, goals, fast_until_s)
        elif goals:
            self._burst.send(goals)
        return Turn(asked, firm, tried)

    def exchange(self, asked: tuple[int, ...], goals: bytes, deadline_s: float) -> Mapping[int, Outcome]:
        """``ask`` and ``hear``, with few steps while all is well."""
        burst = self._burst
        plan = burst.steady
        if (
            plan is None
            or plan.servo_ids != asked
            or not burst.clean
            or plan.fast is not (self._clock.now() + burst.repeat_s <= deadline_s)
        ):
            return self.hear(self.ask(asked, goals, deadline_s), deadline_s)
        states = burst.cycle(plan, goals, deadline_s)
        if states is not None:
            return states
        return self._made_up(Turn(asked, asked, ()), dict(burst.recover(plan, deadline_s)), deadline_s)

    def hear(self, turn: Turn, deadline_s: float) -> dict[int, Outcome]:
        """What has become of the question; asked again while there is time, if something is missing."""
        outcome = dict(self._burst.hear(turn.firm, turn.tried, deadline_s)) if turn.firm else {}
        return self._made_up(turn, outcome, deadline_s)

    def _made_up(self, turn: Turn, outcome: dict[int, Outcome], deadline_s: float) -> dict[int, Outcome]:
        """Whoever is missing is asked again while there is time."""
        asked, firm, _ = turn
        count_skipped(self._counters, asked, outcome)
        self._first = self._burst.asked if firm else {}
        self.missed.clear()
        if not (self._burst.clean and firm == asked):
            missing = self._note(outcome)
            self.missed.update(missing)
            self._ask_again([i for i in _worth_asking(missing, outcome) if i in firm], outcome, deadline_s)
        elif self._absent.misses:
            self._note(outcome)
        return outcome

    def proofs(self) -> dict[int, bool]:
        """Who was asked in the last cycle for a block that proves itself, and whether a state came at once."""
        return {i: i not in self.missed for i, block in self._first.items() if block.proof}

    def _ask_again(self, missing: list[int], outcome: dict[int, Outcome], deadline_s: float) -> None:
        """Only what is missing, and only while there is time."""
        for _ in range(RETRIES):
            if not missing or not self._has_time(missing, deadline_s):
                return
            for servo_id in missing:
                self._counters.of(servo_id).retries += 1
            again = self._burst.read((), tuple(missing), deadline_s)
            outcome.update(again)
            missing = _worth_asking(self._note(again), again)

    def _has_time(self, servo_ids: Sequence[int], deadline_s: float) -> bool:
        """Whether those can be asked again and waited for."""
        # Also for the question, which is no longer than one more reply.
        size = (X.blocks[0].size + 2 * wire.OVERHEAD) * (len(servo_ids) + 1)
        return self._clock.now() + size * BITS_PER_BYTE / self._port.baud + TRIED_GAP_S < deadline_s

    def _note(self, outcome: Mapping[int, Outcome]) -> list[int]:
        """Who has given no state. The first of them may hide the others: it goes to the end of the queue."""
        missing = self._absent.note(outcome, self._clock.now())
        missing = missing[1:] + missing[:1]
        self._queue = [i for i in self._queue if i not in outcome] + missing
        return missing

    def _queued(self, servo_ids: tuple[int, ...]) -> tuple[int, ...]:
        """Those that were missing in the order in which to try them."""
        return tuple(i for i in self._queue if i in servo_ids)


def _worth_asking(missing: list[int], outcome: Mapping[int, Outcome]) -> list[int]:
    """Not who has lost its map: it would answer the same again."""
    return [i for i in missing if outcome[i] != "reset"]
