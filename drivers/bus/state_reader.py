"""Decide when to request the state of each servo.

All servos are read together if possible. Missing states are requested again, and silent servos are asked last."""

import logging
import math
from collections.abc import Mapping, Sequence
from typing import cast

from drivers.bus.adaptive_timeout import RESPONSIVE_S, SPARE_S
from drivers.bus.backoff import Backoff
from drivers.bus.counters import BusCounters
from drivers.bus.group_read import GROUP_WAIT_S, GroupRead
from drivers.bus.known_servos import KnownServos
from drivers.bus.late_replies import LateReplyFilter
from drivers.bus.read_plan import ReadPlan, ReadResult, register_plan
from drivers.bus.retry import CYCLE_RETRIES
from drivers.port.line import GAP_S, Line
from drivers.servos.register import Register
from drivers.types import Reading, ServoState, fault

LOG = logging.getLogger("servoloop.drivers")

Batch = tuple[tuple[int, ...], int]
"""Servos that are asked together, and the number of leading servos that are expected to respond."""


class StateReader:
    """State reads of one bus. The only exception that is raised is PortLost."""

    def __init__(
        self, line: Line, group: GroupRead, servos: KnownServos, counters: BusCounters, late: LateReplyFilter
    ) -> None:
        self._line = line
        self._group = group
        self._servos = servos
        self._counters = counters
        self._late = late
        self._backoff = Backoff()
        self._asked: tuple[int, ...] = ()
        self._batches: list[Batch] = []
        self._plan: ReadPlan | None = None
        """Plan of the request whose replies have not been received yet."""
        self._responsive = 0
        self._no_time: frozenset[int] = frozenset()
        """Servos for which the last cycle had no time left. The next cycle asks these servos first."""
        self._hidden: frozenset[int] = frozenset()
        """Servos that a silent servo may have silenced in their last group read. The next requests to them are
        separate.
        """
        self._split = False
        """Whether the last cycle asked hidden servos separately."""
        self.deadline_s = math.inf
        self._reported = servos.read_together

    @property
    def _sync(self) -> bool:
        return self._servos.in_sync

    def request(self, asked: tuple[int, ...], deadline_s: float) -> None:
        """Send the first request of a cycle."""
        if self._plan is not None:
            self._group.abandon(self._plan)
            self._plan = None
        if not self._reported:
            self._reported = True
            self._log_separate_reads(asked)
        self._asked, self.deadline_s, self._batches = asked, deadline_s, []
        now_s = self._line.now()
        if now_s >= deadline_s or not asked:
            return
        self._split = False
        if self._sync and not self._backoff.misses and not self._hidden:
            self._send(asked, len(asked), deadline_s)
            return
        self._group.timeout.begin()
        self._batches = self._batches_of(asked, now_s)
        if self._batches:
            self._send(*self._batches.pop(0), deadline_s)

    def _batches_of(self, asked: tuple[int, ...], now_s: float) -> list[Batch]:
        responsive, probed = self._backoff.split(asked, now_s)
        if self._sync:
            return self._sync_batches(responsive, probed)
        together = self._servos.together(responsive)
        alone = sorted((i for i in responsive if i not in together), key=lambda i: i not in self._no_time)
        first = [(together, len(together))] if together else []
        return [*first, *(((i,), 1) for i in alone), *(((i,), 0) for i in probed)]

    def _sync_batches(self, responsive: tuple[int, ...], probed: tuple[int, ...]) -> list[Batch]:
        hidden = [i for i in responsive if i in self._hidden]
        if not hidden:
            # If all servos are silent, the adapter may be slow, so they get the long timeout of responsive servos.
            both = responsive + probed
            return [(both, len(responsive) or len(both))] if both else []
        self._split = True
        answering = tuple(i for i in responsive if i not in self._hidden)
        batches: list[Batch] = [(answering, len(answering)), *(((i,), 0) for i in hidden), (probed, 0)]
        return [batch for batch in batches if batch[0]]

    def _send(self, servo_ids: tuple[int, ...], responsive: int, deadline_s: float) -> None:
        fast = self._group.fast
        may = fast.known and responsive == len(servo_ids) and fast.allowed()
        plan = self._fast_or_none(servo_ids, deadline_s) if may else None
        if plan is None:
            plan = self._servos.plan(servo_ids, self._place(servo_ids) if self._late.open else 0)
        self._plan = plan
        self._responsive = responsive
        self._group.send(plan)

    def _place(self, servo_ids: tuple[int, ...]) -> int:
        """Return the index of the block to request, so that a late reply cannot be mistaken for the reply to this
        request."""
        self._late.forget(self._line.now())
        return self._late.place({i: [block.size for block in self._servos.blocks(i)] for i in servo_ids})

    def receive(self) -> Mapping[int, Reading]:
        """Return the states or faults of this cycle. Missing states are requested again while time remains."""
        plan, asked = self._plan, self._asked
        results = self._collect(self._until_s(plan.servo_ids) if plan and not self._sync else self.deadline_s)
        while self._batches:
            batch = self._batches.pop(0)
            if self._has_time(batch[0], self.deadline_s):
                self._send(*batch, self.deadline_s)
                results = {**results, **self._collect(self._until_s(batch[0]))}
        if plan is not None and plan.servo_ids == asked and self._group.complete and not self._backoff.misses:
            self._no_time = frozenset()
            return cast(Mapping[int, Reading], results)
        return self._complete(dict(results))

    def _collect(self, deadline_s: float) -> Mapping[int, ReadResult]:
        plan = self._plan
        if plan is None:
            return {}
        self._plan = None
        try:
            results = self._group.collect(plan, self._responsive, deadline_s)
        except BaseException:
            self._group.abandon(plan)
            raise
        self._hidden = self._hidden - results.keys() | frozenset(self._group.hidden)
        return results if results or not plan.fast else self._read_separately(plan.servo_ids, deadline_s)

    def _read_separately(self, servo_ids: tuple[int, ...], deadline_s: float) -> Mapping[int, ReadResult]:
        """After a failed fast read, read servos again with separate replies to find out which of them failed.

        The servo at which the fast read ended is asked last. Otherwise, it could silence the servos after it again.
        """
        if not self._has_time(servo_ids, deadline_s):
            return {}
        replied = self._group.fast_replies
        ended = servo_ids[replied : replied + 1]
        order = (*servo_ids[:replied], *servo_ids[replied + 1 :], *ended)
        self._send(order, len(order), deadline_s)
        results = self._collect(deadline_s)
        return {i: results[i] for i in servo_ids if i in results}

    def _complete(self, results: dict[int, ReadResult]) -> Mapping[int, Reading]:
        """Count servos that were not asked, and repeat the requests to servos that were expected to respond."""
        expected = [i for i in results if i not in self._backoff.misses]
        self._count_unasked(results)
        missing = self._backoff.note(results, self._line.now())
        self._repeat_requests([i for i in missing if i in expected], results)
        if self._split and not any(isinstance(result, ServoState) for result in results.values()):
            self._hidden = frozenset()  # the adapter may be slow, so the next cycle waits longer for a group read
        return self._readings(results)

    def _count_unasked(self, results: Mapping[int, ReadResult]) -> None:
        unasked = [i for i in self._asked if i not in results]
        silent = self._backoff.misses.keys()
        self._no_time = frozenset(i for i in unasked if i not in silent)
        for servo_id in unasked:
            account = self._counters.of(servo_id)
            account.skipped += servo_id in silent
            account.no_time += servo_id not in silent

    def _readings(self, results: Mapping[int, ReadResult]) -> dict[int, Reading]:
        readings: dict[int, Reading] = {}
        for servo_id in self._asked:
            result = results.get(servo_id, "no_time" if servo_id in self._no_time else "silent")
            if result == "no_time" and servo_id in self._backoff.misses:
                result = "silent"
            readings[servo_id] = fault(servo_id, result) if isinstance(result, str) else cast(Reading, result)
        return readings

    def _repeat_requests(self, missing: Sequence[int], results: dict[int, ReadResult]) -> None:
        for _ in range(CYCLE_RETRIES):
            # A servo that has lost its map would send the same reply again.
            repeatable = [i for i in missing if results[i] != "reset"]
            again: dict[int, ReadResult] = {}
            for servo_ids in self.groups(repeatable):
                if self._has_time(servo_ids, self.deadline_s, GAP_S):
                    for servo_id in servo_ids:
                        self._counters.of(servo_id).retries += 1
                    self._send(servo_ids, 0, self.deadline_s)
                    again |= self._collect(self._until_s(servo_ids))
            if not again:
                return
            results |= {i: result for i, result in again.items() if i not in self._hidden}
            missing = self._backoff.note(again, self._line.now())

    def groups(self, servo_ids: Sequence[int]) -> list[tuple[int, ...]]:
        """Group servos, some of which may be silent. In a bulk read, a silent servo would hide the servos after it."""
        together = self._servos.together(tuple(servo_ids)) if self._servos.protocol.group_read == "sync" else ()
        return ([together] if together else []) + [(i,) for i in servo_ids if i not in together]

    def ask(self, servo_id: int) -> ReadResult:
        """Read the state of one servo once, outside a control cycle."""
        return self._read_all((servo_id,))[servo_id]

    def read_without_deadline(self, asked: tuple[int, ...]) -> Mapping[int, Reading]:
        """Read the states of all servos without a deadline."""
        # Silent servos are asked last. Servos that may have waited for a silent servo are asked again.
        self._asked, self._no_time = asked, frozenset()
        self._group.timeout.begin()
        responsive, probed = self._backoff.split(asked, math.inf)
        results = self._read_all(responsive + probed)
        self._backoff.note(results, self._line.now())
        if hidden := [i for i in responsive if i in self._hidden]:
            again = self._read_hidden(hidden)
            self._backoff.note(again, self._line.now())
            results |= again
        self._try_fast_once(asked)
        return self._readings(results)

    def _read_hidden(self, hidden: list[int]) -> dict[int, ReadResult]:
        """Read the servos that a silent servo may have silenced, first together and then separately if it happens
        again."""
        for servo_id in hidden:
            self._counters.of(servo_id).retries += 1
        results = self._read_all(tuple(hidden))
        for servo_id in hidden:
            if servo_id in self._hidden:
                self._send((servo_id,), 0, math.inf)
                results |= self._collect(math.inf)
        return results

    def _read_all(self, servo_ids: tuple[int, ...]) -> dict[int, ReadResult]:
        results: dict[int, ReadResult] = {}
        for together in self.groups(servo_ids):
            self._send(together, len(together), -math.inf)
            results |= self._collect(math.inf)
        return results

    def registers(self, registers: Mapping[int, Register], deadline_s: float) -> dict[int, int]:
        """Read one register of each servo once. Servos that do not reply before the deadline are omitted."""
        # Servos are omitted if a late reply, even one to a single request, may have the same size as this reply.
        now_s, late = self._line.now(), self._late
        asked = [i for i, r in registers.items() if late.single_until_s(i) <= now_s and not late.ambiguous({i: r.size})]
        asked.sort(key=lambda servo_id: servo_id in self._backoff.misses)  # a silent servo may hide the servos after it
        found: dict[int, int] = {}
        for together in self.groups(asked):
            separate = not self._servos.separate.isdisjoint(together)
            plan = register_plan(self._servos.protocol, {i: registers[i] for i in together}, separate=separate)
            if self._fits(plan.exchange_size, deadline_s, GAP_S):
                self._group.send(plan)
                results = self._group.collect(plan, len(together), deadline_s)
                found |= {i: result for i, result in results.items() if isinstance(result, int)}
        return found

    # Fast sync reads.

    def _try_fast_once(self, servo_ids: tuple[int, ...]) -> None:
        """Try fast sync reads once for each bus, outside a control cycle and after all servos have replied."""
        if self._group.fast.tried or not servo_ids or self._backoff.misses or not self._line.clean:
            return
        plan = self._servos.fast_plan(servo_ids)
        if plan is not None:
            self._group.fast.trial(plan)

    def _fast_or_none(self, servo_ids: tuple[int, ...], deadline_s: float) -> ReadPlan | None:
        """Return the plan of a fast sync read, or None if there would be no time left to read all servos again
        afterward.

        Fast reads are not used while late replies are possible, because only separate replies can be told apart.
        """
        if self._late.open:
            self._late.forget(self._line.now())
        plan = None if self._late.open else self._servos.fast_plan(servo_ids)
        if plan is None:
            return None
        size = plan.exchange_size + self._servos.plan(servo_ids).exchange_size
        return plan if self._fits(size, deadline_s, GROUP_WAIT_S + GAP_S) else None

    # Time.

    def exchange_size(self, asked: tuple[int, ...]) -> int:
        fast = self._servos.fast_plan(asked) if self._group.fast.known else None
        groups = [asked] if self._servos.read_together else self.groups(asked)
        plans = [fast] if fast else [self._servos.plan(servo_ids) for servo_ids in groups]
        return sum(plan.exchange_size for plan in plans)

    def _fits(self, size: int, deadline_s: float, gap_s: float = 0.0) -> bool:
        begin_s = max(self._line.now(), self._line.busy_until_s)
        return begin_s + size * self._line.byte_s + gap_s < deadline_s

    def _size_of(self, servo_ids: tuple[int, ...]) -> int:
        return self._servos.plan(servo_ids, self._place(servo_ids) if self._late.open else 0).exchange_size

    def _has_time(self, servo_ids: tuple[int, ...], deadline_s: float, gap_s: float = 0.0) -> bool:
        return self._fits(self._size_of(servo_ids), deadline_s, gap_s)

    def _until_s(self, servo_ids: tuple[int, ...]) -> float:
        """Return the deadline for these servos, chosen so that a silent servo does not use up the time of later
        servos."""
        if self._sync:
            return self.deadline_s
        byte_s = self._line.byte_s
        # In a bulk read, servos hidden by a silent servo are asked again separately.
        later = [ids for ids, _ in self._batches] + ([(i,) for i in servo_ids] if len(servo_ids) > 1 else [])
        needed_s = sum(self._size_of(ids) * byte_s + RESPONSIVE_S for ids in later)
        at_least_s = self._line.now() + self._size_of(servo_ids) * byte_s + SPARE_S
        return min(max(self.deadline_s - needed_s, at_least_s), self.deadline_s)

    def _log_separate_reads(self, servo_ids: tuple[int, ...]) -> None:
        count, port = len(servo_ids), self._line.port
        LOG.info(
            "%s: these %s servos do not support a group read, so the %d servos are read one by one: this takes %.2f ms "
            "of every cycle at %d baud, plus %d times the adapter's delay",
            port.name, self._servos.protocol.name, count, 1e3 * self.exchange_size(servo_ids) * self._line.byte_s,
            port.baud, count,
        )  # fmt: skip
