"""A group read asks several servos by one packet, waits for all their replies together and judges what came."""

import logging
import math
from collections.abc import Mapping
from operator import attrgetter
from typing import Final

from drivers.bus.adaptive_timeout import FIRST_REPLY_S, AdaptiveTimeout
from drivers.bus.counters import BusCounters
from drivers.bus.late_replies import LateReplies, Missed
from drivers.bus.read_plan import ReadPlan, ReadResult, fast_results
from drivers.bus.reply_assembler import ReplyAssembler
from drivers.bus.types import ServoFault, ServoState
from drivers.clock import Clock
from drivers.port import Port
from drivers.port.echo import Echo
from drivers.protocol import v2
from drivers.protocol.decoder import Reply
from drivers.servos.series import WireProtocol

LOG = logging.getLogger("servoloop.drivers")

BITS_PER_BYTE: Final = 10.0
GROUP_WAIT_S: Final = 0.002
"""How long after its time a group's answer may still come. Not less than a tick of most kernels: each piece of an
answer wakes us, and to sleep on until before the next tick costs two settings of the clock's timer."""
GAP_S: Final = 0.0015
"""How long the next piece may take once some have come."""
TURNAROUND_S: Final = 0.0005
"""A servo whose answer was due so shortly before the cycle's end, or later, had no time to give it."""
_MANY: Final = 4096
"""More bytes than a line holds back."""
FAST_TRIES: Final = 5
"""After so many broken answers in a row there are no more fast sync reads."""

FAST_TRIAL_S: Final = 0.005
"""How long the answer to the trial of a fast sync read may take beside its time on the wire."""

_ALARMS_OF: Final = attrgetter("alarms")


class GroupRead:
    """The group reads on one port. Counts what goes wrong; raises only PortLost."""

    def __init__(
        self,
        port: Port,
        clock: Clock,
        protocol: WireProtocol,
        echo: Echo,
        counters: BusCounters,
        late: LateReplies,
    ) -> None:
        self._port = port
        self._clock = clock
        self._protocol = protocol
        self._echo = echo
        self._counters = counters
        self._late = late
        self.adaptive = False
        """Whether servos are asked by themselves: then each has a wait of its own, learnt from the replies."""
        self.timeout = AdaptiveTimeout()
        self.byte_s = BITS_PER_BYTE / port.baud
        self.busy_until_s = 0.0
        """Until when what was sent is on the wire."""
        self._sent_s = 0.0
        self.clean = False
        """Whether nothing can be left of the last answer to throw away."""
        self.whole = False
        """Whether the last answer came as a whole, a state of each."""
        self.fast = False
        """Whether the servos answer fast sync reads; ``try_fast`` finds out."""
        self._broken_in_a_row = 0

    def send(self, packet: bytes) -> None:
        """Send a packet that nobody answers. Its echo, if there is one, is taken off the line at once."""
        self._port.write(packet)
        now_s, on_wire_s = self._clock.now(), len(packet) * self.byte_s
        self.busy_until_s = (self.busy_until_s if self.busy_until_s > now_s else now_s) + on_wire_s
        if self._echo.present:
            self._port.read(len(packet), self.busy_until_s + on_wire_s + GAP_S)

    def ask(self, plan: ReadPlan) -> None:
        """Send the question."""
        now_s = self._clock.now()
        begin_s = self.busy_until_s if self.busy_until_s > now_s else now_s
        self._sent_s = begin_s + len(plan.request) * self.byte_s
        if not self.clean:
            self._take_what_waits()
        self.clean = self.whole = False
        self._port.write(plan.request)

    def _take_what_waits(self) -> None:
        """What has come since the last question is nobody's answer, but it may close questions that were given up.

        After a stall there is one reply to each of them: without a look, all would stay open.
        """
        if self._late:
            sizes = self._late.sizes()
            decoder = self._protocol.packets.ReplyDecoder(min(sizes, default=0), sizes, self._protocol.refusals)
            for reply in decoder.feed(self._port.read(_MANY, self._clock.now())) + decoder.finish():
                self._close_late(reply)
        self._port.discard_input()

    def _close_late(self, reply: Reply, asked: bool = False) -> bool:
        """Whether the reply may be one to an earlier question; then it is counted as late."""
        counted_as = self._late.take(reply.servo_id, len(reply.data), asked)
        if counted_as is None:
            return False
        self._counters.of(reply.servo_id).came_late(counted_as)
        self.timeout.heard_late()
        return True

    def collect(self, plan: ReadPlan, responsive: int, deadline_s: float) -> Mapping[int, ReadResult]:
        """The state of each servo that was asked, or what kind of fault there was.

        The first ``responsive`` servos of the plan are expected to answer; the others are waited for shortly.
        """
        expected = plan.reply_size
        if 0 < responsive < len(plan.servo_ids):
            expected = plan.bytes_from(plan.servo_ids[:responsive])
        due_s = self._sent_s + expected * self.byte_s
        if self.adaptive:  # another line may have been waited for until now
            due_s = max(due_s, self._clock.now())
        wait_s = self._wait_s(plan, responsive)
        data = self._first_data(plan, expected, due_s, wait_s, deadline_s)
        if not self._late or not self._late.doubtful(plan.sizes):
            states = plan.whole(data)
            if states is not None:
                return self._all_well(plan, states, due_s)
        if plan.fast:
            return self._judge_broken(plan, data, deadline_s)
        if not data and responsive and not self.adaptive:
            data = self._after_silence(expected, deadline_s)
        return self._piecewise(plan, responsive, data, wait_s, due_s, deadline_s)

    def abandon(self, plan: ReadPlan) -> None:
        """Nobody will wait for the answers to the last question, which are still on their way."""
        self._count(dict.fromkeys(plan.servo_ids, "no_time"), plan)

    def _wait_s(self, plan: ReadPlan, responsive: int) -> float:
        """How long to wait beyond the bytes' own time."""
        if self.adaptive:
            return self.timeout.wait_s(responsive > 0)
        return GROUP_WAIT_S if responsive else GAP_S

    def _first_data(self, plan: ReadPlan, expected: int, due_s: float, wait_s: float, deadline_s: float) -> bytes:
        """The whole answer if it comes in time, or else what there is of it."""
        until_s = due_s + wait_s
        if deadline_s < until_s:
            until_s = deadline_s
        if self._echo.present is False:
            return self._port.read(expected, until_s)
        sent = plan.request
        echoed = self._echo.expected(sent)
        data = self._port.read(echoed + expected, until_s + echoed * self.byte_s)
        if self._echo.present is None and data and sent.startswith(data):
            # Nobody knew of an echo, and it is so long that there is nothing else yet.
            data += self._port.read(len(sent) - len(data) + expected, until_s)
        return self._echo.strip(sent, data)

    def _after_silence(self, expected: int, deadline_s: float) -> bytes:
        """Nobody has answered: the adapter may be a slow one."""
        data = self._port.read(1, min(self._sent_s + FIRST_REPLY_S, deadline_s))
        if not data:
            return data
        return data + self._port.read(expected - 1, min(self._clock.now() + expected * self.byte_s + GAP_S, deadline_s))

    def _all_well(self, plan: ReadPlan, states: Mapping[int, ServoState], due_s: float) -> Mapping[int, ServoState]:
        self.clean = self.whole = True
        if self._echo.present is None:
            self._echo.present = False
        if self._late:
            now_s = self._clock.now()
            for servo_id in plan.servo_ids:
                self._late.answered(servo_id, now_s)
        if self.adaptive:
            self.timeout.heard(self._clock.now() - due_s)
        if plan.fast:
            self._broken_in_a_row = 0
        for servo_id in plan.servo_ids:
            self._counters.of(servo_id).replies += 1
        if any(map(_ALARMS_OF, states.values())):
            for servo_id, state in states.items():
                self._counters.of(servo_id).alarms += bool(state.alarms)
        return states

    def _piecewise(
        self, plan: ReadPlan, responsive: int, data: bytes, wait_s: float, due_s: float, deadline_s: float
    ) -> Mapping[int, ReadResult]:
        """Something is missing or there is garbage: piece by piece until the line falls silent."""
        size = min(plan.sizes.values())
        others = self._late.sizes().union(plan.sizes.values()) - {size}
        decoder = self._protocol.packets.ReplyDecoder(size, others, self._protocol.refusals)
        assembler = ReplyAssembler(plan.sizes, plan.overhead, decoder, self._late.servos(self._clock.now()))
        assembler.feed(data)
        noise = self._counters.noise
        if data:
            self._wait_for(assembler, plan.servo_ids[:responsive], wait_s, deadline_s)
        if data or responsive:
            self._wait_for(assembler, plan.servo_ids[responsive:], GAP_S, deadline_s)
        assembler.finish()
        self._learn(assembler, plan, due_s)
        in_time = deadline_s >= due_s + TURNAROUND_S
        results = self._judge(plan, assembler, "silent" if in_time else "no_time")
        self.clean = len(assembler.answered) == len(plan.servo_ids) and self._counters.noise == noise
        return results

    def _wait_for(
        self, assembler: ReplyAssembler, servo_ids: tuple[int, ...], wait_s: float, deadline_s: float
    ) -> None:
        # However much noise there is.
        end_s = min(self._clock.now() + FIRST_REPLY_S + GAP_S * len(servo_ids), deadline_s)
        while missing := assembler.bytes_missing(servo_ids):
            gap_s = min(wait_s, GAP_S) if assembler.replies else wait_s
            data = self._port.read(missing, min(self._clock.now() + missing * self.byte_s + gap_s, end_s))
            if not data:
                return
            assembler.feed(data)

    def _learn(self, assembler: ReplyAssembler, plan: ReadPlan, due_s: float) -> None:
        """How long single replies take."""
        if not self.adaptive:
            return
        if assembler.answered:
            self.timeout.heard(self._clock.now() - due_s)
        else:
            self.timeout.in_vain()

    def _judge(self, plan: ReadPlan, assembler: ReplyAssembler, nothing: Missed) -> dict[int, ReadResult]:
        """A value or a fault for every servo that was asked, each counted once."""
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
                if not isinstance(result, ServoFault):  # a refusal may be that of an earlier question
                    self._late.answered(reply.servo_id, self._clock.now())
        corrupt, noise = assembler.corrupted()
        self._counters.noise += noise
        for servo_id in plan.servo_ids:
            if servo_id not in results:
                results[servo_id] = "corrupt" if servo_id in corrupt else "late" if servo_id in late else nothing
        self._count(results, plan)
        return results

    def _count(self, results: Mapping[int, ReadResult], plan: ReadPlan) -> None:
        """Count each question once."""
        now_s = self._clock.now()
        for servo_id, result in results.items():
            account = self._counters.of(servo_id)
            if isinstance(result, ServoFault):
                account.refused += 1
                if servo_id in self._late.servos(now_s):
                    self._leave_open(plan, servo_id, now_s, "refused")
            elif result == "reset":  # the servo has answered
                account.reset += 1
            elif isinstance(result, str):
                missed: Missed = "silent" if result == "late" else result
                account.add(missed)
                self._leave_open(plan, servo_id, now_s, missed)
            else:
                account.replies += 1
                account.alarms += isinstance(result, ServoState) and bool(result.alarms)

    def _leave_open(self, plan: ReadPlan, servo_id: int, now_s: float, counted: Missed) -> None:
        if plan.blocks:
            self._late.add(servo_id, plan.sizes[servo_id], now_s, counted)
        else:  # a register, of a size that a servo may be asked for by itself too
            self._late.add_single(servo_id, now_s)

    # Fast sync reads: one packet in which each servo has its piece. Who is silent silences those behind.

    def try_fast(self, plan: ReadPlan) -> None:
        """Ask servos that have just answered once more, fast, and remember whether they did.

        Not for a cycle: whoever does not know the instruction costs a wait. Nothing is counted. An adapter so
        slow that the answer does not come soon gets no fast reads: a silent first servo silences all, and
        would cost the slow adapter's whole wait in the cycle.
        """
        self.clean = False
        self.ask(plan)
        due_s = self._sent_s + plan.reply_size * self.byte_s
        self.fast = plan.whole(self._first_data(plan, plan.reply_size, due_s, FAST_TRIAL_S, math.inf)) is not None
        self.clean = False
        if not self.fast:
            LOG.info("%s: not every servo knows fast sync reads: their states by plain ones", self._port.name)

    def _judge_broken(self, plan: ReadPlan, data: bytes, deadline_s: float) -> Mapping[int, ReadResult]:
        """What can be believed of a fast sync read's packet; no more of these after too many that were broken."""
        results = self._judge_pieces(plan, data, deadline_s)
        self._broken_in_a_row += bool({"silent", "corrupt"} & {r for r in results.values() if isinstance(r, str)})
        if self._broken_in_a_row == FAST_TRIES:
            self.fast = False
            LOG.warning("%s: %d fast sync reads broken in a row: plain ones from now on", self._port.name, FAST_TRIES)
        return results

    def _judge_pieces(self, plan: ReadPlan, data: bytes, deadline_s: float) -> dict[int, ReadResult]:
        """What can be believed of a packet that did not come as a whole; the caller asks for the rest again."""
        assert plan.fast is not None
        count, size = len(plan.servo_ids), plan.fast[1].size
        piece = size + v2.FAST_OVERHEAD
        begin = data.find(v2.fast_head(count, size))
        if begin > 0:  # behind noise, so as many bytes of it are still to come
            data += self._port.read(begin, min(self._clock.now() + begin * self.byte_s + GAP_S, deadline_s))
        results = fast_results(plan.fast, self._protocol, data[begin:]) if begin >= 0 else {}
        garbage = len(data) - max(begin, 0) - len(results) * piece - v2.FAST_HEAD_SIZE
        for servo_id in plan.servo_ids[len(results) :]:
            corrupt = garbage > piece - piece // 2
            results[servo_id] = "corrupt" if corrupt else "silent"
            garbage -= piece if corrupt else 0
        self._counters.noise += (begin > 0) + (garbage > 0)
        self._count(results, plan)
        return results
