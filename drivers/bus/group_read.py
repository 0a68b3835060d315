"""Read several servos with one request packet, and determine the fault of each servo that sent no valid reply."""

from collections.abc import Collection, Mapping
from typing import Final

from drivers.bus.adaptive_timeout import FIRST_REPLY_S, AdaptiveTimeout
from drivers.bus.counters import BusCounters, ServoCounters
from drivers.bus.fast_read import FastReads, replies_in
from drivers.bus.late_replies import LateReplyFilter, Missed
from drivers.bus.read_plan import ReadPlan, ReadResult
from drivers.bus.reply_assembler import ReplyAssembler
from drivers.port.line import GAP_S, Line
from drivers.protocol.decoder import Reply
from drivers.servos.series import WireProtocol
from drivers.types import FaultKind, ServoFault, ServoState

GROUP_WAIT_S: Final = 0.002
"""Timeout for the replies of a group, beyond the transmission time, in seconds. This timeout is at least one timer tick
of most kernels. If a wait ended before the next tick, the kernel would have to set its timer twice for each fragment of
a reply.
"""
TURNAROUND_S: Final = 0.0005
"""Time a servo needs to reply, in seconds. If less time is left in the cycle, a missing reply is not the servo's
fault."""
FAST_LATE_S: Final = 0.004
"""Maximum additional wait for a fast reply of which no part has arrived, in seconds. A busy machine delays replies."""
DRAIN_S: Final = 0.002
"""Maximum time for discarding input after the bus was flooded with bytes, in seconds."""
_MANY: Final = 4096
"""Maximum number of bytes per read, which is more than any input buffer holds."""


class GroupRead:
    """Group reads of one bus. Faults are counted and returned. The only exception raised is PortLost."""

    def __init__(self, line: Line, protocol: WireProtocol, counters: BusCounters, late: LateReplyFilter) -> None:
        self._line = line
        self._protocol = protocol
        self._counters = counters
        self._late = late
        self.adaptive = protocol.group_read != "sync"
        """Whether servos may be asked separately, with an adaptive timeout for each."""
        self._counters_of: dict[tuple[int, ...], list[ServoCounters]] = {}
        self._sent_s = 0.0
        self._flooded = False
        """Whether bytes kept arriving until the end of the last wait."""
        self.timeout = AdaptiveTimeout()
        self.fast = FastReads(line)
        self._prompt = False
        """Whether the adapter is known to be prompt: complete replies have arrived within ``GROUP_WAIT_S``, and no
        later read received no reply."""
        self.complete = False
        """Whether the last read returned the state of every servo."""
        self.fast_replies = 0
        """Number of servos that replied to the last fast read before it failed."""
        self.hidden: tuple[int, ...] = ()
        """Servos whose reply to the last read may be missing only because a servo before them is silent."""

    def send(self, plan: ReadPlan) -> None:
        if not self._line.clean:
            self._drain_input()
        self._sent_s = self._line.send_request(plan.request)

    def _drain_input(self) -> None:
        """Discard the input received since the last request. Late replies found in the input close their requests.

        After a stall, the input holds a reply to each open request. After a flood of bytes, a flush discards only part
        of the input, and the remainder would precede the next replies.
        """
        port, end_s = self._line.port, self._line.now() + DRAIN_S
        if self._late.open:
            sizes = self._late.sizes()
            decoder = self._protocol.packets.ReplyDecoder(min(sizes, default=0), sizes, self._protocol.refusals)
            for reply in decoder.feed(port.read(_MANY, self._line.now())) + decoder.finish():
                self._close_late(reply)
        port.discard_input()
        while self._flooded and self._line.now() < end_s:
            self._flooded = bool(port.read(_MANY, self._line.now()))

    def _close_late(self, reply: Reply, asked: bool = False) -> bool:
        """Count the reply as late if it may belong to an earlier request. Return whether it is late."""
        counted_as = self._late.match(reply.servo_id, len(reply.data), asked)
        if counted_as is None:
            return False
        self._counters.of(reply.servo_id).count_late(counted_as)
        self.timeout.late_reply_received()
        return True

    def collect(self, plan: ReadPlan, responsive: int, deadline_s: float) -> Mapping[int, ReadResult]:
        """Receive the replies and return the state or the fault type of each servo.

        The first ``responsive`` servos of the plan are expected to respond. The other servos get a short timeout. If a
        fast read fails, the result is empty and no fault is counted for any servo.
        """
        line, expected, self.complete, self.hidden = self._line, plan.reply_size, False, ()
        if 0 < responsive < len(plan.servo_ids):
            expected = sum(plan.sizes[i] + plan.overhead for i in plan.servo_ids[:responsive])
        due_s = self._sent_s + expected * line.byte_s
        if self.adaptive:  # the time until now may have been spent on another bus
            due_s = max(due_s, line.now())
            wait_s = self.timeout.wait_s(responsive > 0)
        else:
            wait_s = GROUP_WAIT_S if responsive else GAP_S
        until_s = due_s + wait_s
        data = line.receive(plan.request, expected, until_s if until_s < deadline_s else deadline_s)
        if plan.fast and not data:
            data = self._wait_for_fast_reply(plan, deadline_s)
        if not self._late.open or not self._late.ambiguous(plan.sizes):
            states = plan.decode_all(data)
            if states is not None:
                return self._count_all(plan, states, due_s)
        if plan.fast:
            self._counters.noise += bool(data)
            self.fast_replies = replies_in(plan, data)
            self.fast.failed()
            return {}
        if self._chain_has_ended(plan, len(data) < expected):
            deadline_s = min(deadline_s, line.now())
        elif not data and responsive and not self.adaptive:
            data = self._wait_for_slow_adapter(expected, deadline_s)
        elif len(data) >= expected and line.now() <= until_s:
            self._prompt = True
        self._prompt = self._prompt and bool(data)
        return self._decode_separately(plan, responsive, data, wait_s, due_s, deadline_s)

    def _chain_has_ended(self, plan: ReadPlan, missing: bool) -> bool:
        """Return whether no more replies can arrive, because a silent servo silences the servos after it.

        The adapter must be known to deliver replies promptly. A slow adapter may still deliver the missing replies.
        """
        return missing and self._prompt and self._protocol.waits_for_silent and len(plan.servo_ids) > 1

    def abandon(self, plan: ReadPlan) -> None:
        """Abandon the last request, whose replies may still arrive."""
        if plan.fast:
            self.fast.failed()
        self._count(plan, dict.fromkeys(plan.servo_ids, "no_time"))

    def _wait_for_fast_reply(self, plan: ReadPlan, deadline_s: float) -> bytes:
        """If no part of a fast reply has arrived, wait longer, as long as time remains for separate replies.

        A failed fast read is expensive, because no other fast read can be sent while its reply may still arrive.
        """
        line = self._line
        separate_s = 2.0 * plan.exchange_size * line.byte_s + GROUP_WAIT_S
        until_s = min(line.now() + FAST_LATE_S, deadline_s - separate_s)
        return line.receive(plan.request, plan.reply_size, until_s) if until_s > line.now() else b""

    def _wait_for_slow_adapter(self, expected: int, deadline_s: float) -> bytes:
        """Wait longer if no servo has replied, because the adapter may be slow."""
        line = self._line
        data = line.port.read(1, min(self._sent_s + FIRST_REPLY_S, deadline_s))
        if not data:
            return data
        return data + line.port.read(expected - 1, min(line.now() + expected * line.byte_s + GAP_S, deadline_s))

    def _count_all(self, plan: ReadPlan, states: Mapping[int, ServoState], due_s: float) -> Mapping[int, ServoState]:
        line = self._line
        line.clean = self.complete = True
        if line.echoes is None:
            line.echoes = False
        if self._late.open:
            for servo_id in plan.servo_ids:
                self._late.answered(servo_id, line.now())
        self._prompt = True
        if self.adaptive:
            took_s = line.now() - due_s
            self.timeout.reply_received(took_s)
            self._prompt = took_s <= GROUP_WAIT_S
        if plan.fast:
            self.fast.succeeded()
        accounts = self._counters_of.get(plan.servo_ids)
        if accounts is None:
            accounts = self._counters_of[plan.servo_ids] = [self._counters.of(servo_id) for servo_id in plan.servo_ids]
        for account, state in zip(accounts, states.values(), strict=True):
            account.replies += 1
            if state.alarms:
                account.alarms += 1
        return states

    def _decode_separately(
        self, plan: ReadPlan, responsive: int, data: bytes, wait_s: float, due_s: float, deadline_s: float
    ) -> Mapping[int, ReadResult]:
        """Decode replies one by one until no more bytes arrive, because replies are missing or there is garbage."""
        size = min(plan.sizes.values())
        others = self._late.sizes().union(plan.sizes.values()) - {size}
        decoder = self._protocol.packets.ReplyDecoder(size, others, self._protocol.refusals)
        assembler = ReplyAssembler(plan.sizes, plan.overhead, decoder, self._late.servos(self._line.now()))
        assembler.feed(data)
        if data:
            self._wait_for(assembler, plan.servo_ids[:responsive], wait_s, deadline_s)
        if data or responsive:
            self._wait_for(assembler, plan.servo_ids[responsive:], GAP_S, deadline_s)
        assembler.finish()
        if self.adaptive and assembler.answered:
            self.timeout.reply_received(self._line.now() - due_s)
        elif self.adaptive:
            self.timeout.no_reply()
        results, noise = self._judge(plan, assembler, self._had_time(plan, assembler, due_s, deadline_s))
        self._line.clean = len(assembler.answered) == len(plan.servo_ids) and not noise
        return self._count(plan, results, noise)

    def _wait_for(
        self, assembler: ReplyAssembler, servo_ids: tuple[int, ...], wait_s: float, deadline_s: float
    ) -> None:
        line = self._line
        # This deadline also applies if noise keeps arriving.
        end_s = min(line.now() + FIRST_REPLY_S + GAP_S * len(servo_ids), deadline_s)
        while missing := assembler.bytes_missing(servo_ids):
            gap_s = min(wait_s, GAP_S) if assembler.replies else wait_s
            # If servos wait for each other, a pause means that no more replies will arrive. Otherwise the pause may be
            # the empty slot of a silent servo.
            slots_s = 0.0 if self._protocol.waits_for_silent else missing * line.byte_s
            until_s = line.now() + slots_s + gap_s
            only_late = assembler.replies and not assembler.answered
            if only_late and wait_s > GAP_S and not self.adaptive:  # the adapter may be slow
                until_s = max(until_s, self._sent_s + FIRST_REPLY_S)
            data = line.port.read(missing, min(until_s, end_s))
            assembler.feed(data)
            self._flooded = bool(data) and line.now() >= end_s  # bytes keep arriving
            if not data or self._flooded:
                return

    def _had_time(self, plan: ReadPlan, assembler: ReplyAssembler, due_s: float, deadline_s: float) -> Collection[int]:
        """Return the servos that had time to reply before the deadline.

        The time at which a servo's reply is due depends on its place in the order.
        If no servo replied, the cause may be the adapter, except in reads in which the first servo can silence all
        others.
        """
        if deadline_s >= due_s + TURNAROUND_S:
            return plan.servo_ids
        if not assembler.answered and not self._protocol.waits_for_silent:
            return ()
        size, in_time = 0, []
        for servo_id in plan.servo_ids:
            size += plan.sizes[servo_id] + plan.overhead
            if self._sent_s + size * self._line.byte_s + TURNAROUND_S <= deadline_s:
                in_time.append(servo_id)
        return in_time

    def _judge(
        self, plan: ReadPlan, assembler: ReplyAssembler, had_time: Collection[int]
    ) -> tuple[dict[int, ReadResult], int]:
        """Return a value or a fault for every requested servo, and the number of noise sequences."""
        results: dict[int, ReadResult] = {}
        late: set[int] = set()
        for reply in assembler.replies:
            if self._close_late(reply, assembler.fits(reply)):
                late.add(reply.servo_id)
                continue
            result = plan.result(reply) if assembler.fits(reply) else None
            self._counters.strange += result is None or reply.servo_id in results
            if result is not None:
                results[reply.servo_id] = result
                if not isinstance(result, ServoFault):  # a rejection may belong to an earlier request
                    self._late.answered(reply.servo_id, self._line.now())
        corrupt, noise = assembler.corrupted()
        self.hidden = self._after_silent(plan, results.keys() | corrupt)
        for servo_id in plan.servo_ids:
            if servo_id not in results:
                missed: FaultKind = "silent" if servo_id in had_time and servo_id not in self.hidden else "no_time"
                results[servo_id] = "corrupt" if servo_id in corrupt else "late" if servo_id in late else missed
        return results, noise

    def _after_silent(self, plan: ReadPlan, heard: Collection[int]) -> tuple[int, ...]:
        """Return the servos after the silent servo that ended a group read. The result is empty unless each servo waits
        for the previous reply."""
        if not self._protocol.waits_for_silent:
            return ()
        last = max((n for n, servo_id in enumerate(plan.servo_ids) if servo_id in heard), default=-1)
        return plan.servo_ids[last + 2 :]

    def _count(self, plan: ReadPlan, results: dict[int, ReadResult], noise: int = 0) -> Mapping[int, ReadResult]:
        """Count the result of each request. Requests that returned no value stay open for late replies."""
        now_s = self._line.now()
        self._counters.noise += noise
        for servo_id, result in results.items():
            account = self._counters.of(servo_id)
            if isinstance(result, ServoFault):
                account.refused += 1
                if servo_id in self._late.servos(now_s):
                    self._leave_open(plan, servo_id, now_s, "refused")
            elif result == "reset":  # the servo has replied, so the request is closed
                account.reset += 1
            elif isinstance(result, str):
                missed: Missed = "silent" if result == "late" else result
                account.add(missed)
                self._leave_open(plan, servo_id, now_s, missed)
            else:
                account.replies += 1
                account.alarms += isinstance(result, ServoState) and bool(result.alarms)
        return results

    def _leave_open(self, plan: ReadPlan, servo_id: int, now_s: float, counted: Missed) -> None:
        if plan.fast:  # the servos send no separate replies
            return
        self._late.add(servo_id, plan.sizes[servo_id], now_s, counted)
        if not plan.blocks:  # the reply to a request for a single register may have the same size
            self._late.add_single(servo_id, now_s)
