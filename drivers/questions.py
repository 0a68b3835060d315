"""What is asked of one servo by itself: through the maker's SDK, judged and counted like everything else."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

from dynamixel_sdk import COMM_SUCCESS

from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.echo import Echo
from drivers.errors import ServoCorrupt, ServoRefused, ServoSilent
from drivers.owed import HELD_S
from drivers.port import Port
from drivers.sdk_port import CORRUPT, SdkPort

_MANY: Final = 4096
"""More bytes than can come in that time."""
_READ_SIZE: Final = 26
"""Bytes on the wire for reading one register, request and reply, in the longest of the protocols."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """What replies are in one protocol, as its SDK hands them over."""

    sdk: Any
    data_of: Callable[[Any], bytes]
    refusals: int
    """Those bits of a reply's error byte that refuse the instruction. The others are alarms, which are states and no
    failure."""
    refusal: Callable[[int], str]
    """What they say, behind the servo's name."""
    came_broken: Callable[[int], bool]
    """Whether they say that the instruction came broken: that is the line's fault, and it may be given again."""


class Questions:
    """One transaction after the other. Raises ServoError, and PortLost once the line is gone."""

    def __init__(
        self,
        port: Port,
        clock: Clock,
        echo: Echo,
        counters: BusCounters,
        dialect: Dialect,
        before: Callable[[], None],
        owed_until_s: dict[int, float],
    ) -> None:
        """``before`` is called before anything is sent. ``owed_until_s``: until when an answer may still come, by
        servo; who reads states on this line must know that too.
        """
        self._port = port
        self._clock = clock
        self._counters = counters
        self._dialect = dialect
        self._before = before
        self._owed_until_s = owed_until_s
        self._sdk_port = SdkPort(port, clock, echo)

    @property
    def sent_s(self) -> float:
        """When the last instruction went out."""
        return self._sdk_port.sent_s

    @contextmanager
    def until(self, servo_id: int, deadline_s: float) -> Iterator[None]:
        """What is given up at the deadline; ServoSilent at once where there is no time for it."""
        if self._clock.now() + _READ_SIZE * 10.0 / self._port.baud >= deadline_s:
            raise ServoSilent(servo_id, "was not asked: the cycle was over")
        self._sdk_port.latest_s = deadline_s
        try:
            yield
        finally:
            self._sdk_port.latest_s = math.inf

    def say(self, tell: Callable[[Any, SdkPort], Any]) -> Any:
        """One instruction by the SDK, to all servos or such that no single reply comes; what the SDK returns."""
        self._before()
        return tell(self._dialect.sdk, self._sdk_port)

    def ask(self, servo_id: int, request: list[int], size: int | None, what: str) -> bytes:
        """One instruction by the SDK; the reply's data, which must be so many bytes (None: any).

        Raises ServoSilent, ServoCorrupt or ServoRefused. A reply does not say what it answers: while one of this
        servo may still come, nothing is sent to it.
        """
        self._before()
        self._let_pass(servo_id)
        self.owe(servo_id)  # before it is: an interrupt leaves the reply on its way
        reply, result, error = self._dialect.sdk.txRxPacket(self._sdk_port, request)
        self.owe(servo_id)
        self._look_whether_heard(servo_id, self._sdk_port.judged(result))
        data = self._dialect.data_of(reply)
        account = self._counters.of(servo_id)
        if refused := error & self._dialect.refusals:
            account.refused += 1
            del self._owed_until_s[servo_id]
            error_of = ServoCorrupt if self._dialect.came_broken(refused) else ServoRefused
            raise error_of(servo_id, self._dialect.refusal(refused))
        if size is not None and len(data) != size:
            account.late += 1
            raise ServoCorrupt(servo_id, f"answered {len(data)} bytes for {what}")
        account.single_replies += 1
        account.alarms += error != 0
        del self._owed_until_s[servo_id]
        return data

    def owe(self, servo_id: int) -> None:
        """The right answer to the last instruction has not come, and may still."""
        self._owed_until_s[servo_id] = self._clock.now() + HELD_S

    def _look_whether_heard(self, servo_id: int, result: int) -> None:
        account = self._counters.of(servo_id)
        if result in CORRUPT:
            account.corrupt += 1
            raise ServoCorrupt(servo_id, "answered with a broken packet: check the cable's plugs")
        if result != COMM_SUCCESS:
            account.silent += 1
            raise ServoSilent(servo_id, "does not answer: check its power and cable, its ID and the baud rate")

    def _let_pass(self, servo_id: int) -> None:
        """Wait until no reply to a former instruction can come any more; in a cycle there is no time for that."""
        until_s = self._owed_until_s.get(servo_id, -math.inf)
        if self._sdk_port.latest_s < math.inf and self._clock.now() < until_s:
            raise ServoSilent(servo_id, "may still answer the last question, and is not asked before that")
        while self._clock.now() < until_s:
            self._port.read(_MANY, until_s)
