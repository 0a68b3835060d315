"""Serve virtual buses in real time in the caller's thread, each on a pseudo-terminal.

The emulator sleeps between events, and advances the physics before every reply and at least every 5 ms. Replies that
are less than 1 ms apart reach the client together, at the time of the last reply. A USB adapter also delivers bytes
once per USB frame, and fewer deliveries mean fewer wake-ups on both sides.
"""

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from select import select
from typing import Any, Final

from drivers.clock import Clock, MonotonicClock
from sim_backend.buses.pty_link import PtyAdapter, PtyLink
from sim_backend.line.line import DelayedReply, ServoLine

TICK_S: Final = 0.005
LONGEST_CATCH_UP_S: Final = 0.2
USB_FRAME_S: Final = 0.001


def serve(
    bus: ServoLine[Any],
    link: Path,
    *,
    stop: Callable[[], bool],
    on_tick: Callable[[float], None] | None = None,
    on_ready: Callable[[], None] | None = None,
    clock: Clock | None = None,
) -> None:
    """Serve ``bus`` at the path ``link`` until ``stop()`` is true, and then remove the link.

    ``on_tick(reached_s)`` is called at least every 5 ms with the time that the world has reached, and must not block.
    ``on_ready()`` is called once, as soon as clients can open the link. Raises PortBusy if ``link`` is already in use.
    A signal handler only needs to make ``stop()`` return True.
    """
    serve_all({PtyAdapter(link): bus}, stop=stop, on_tick=on_tick, on_ready=on_ready, clock=clock)


def serve_all(
    buses: Mapping[PtyAdapter, ServoLine[Any]],
    *,
    stop: Callable[[], bool],
    on_tick: Callable[[float], None] | None = None,
    on_ready: Callable[[], None] | None = None,
    clock: Clock | None = None,
) -> None:
    """Serve several buses, each behind its own adapter. See ``serve``."""
    clock = clock or MonotonicClock()
    with ExitStack() as stack:
        emulators = [Emulator(bus, stack.enter_context(adapter), clock) for adapter, bus in buses.items()]
        if on_ready is not None:
            on_ready()
        while not stop():
            there = [adapter.line for adapter in buses if adapter.line is not None]
            select(there, [], [], min(emulator.patience_s() for emulator in emulators))
            for emulator in emulators:
                emulator.turn()
            if on_tick is not None:
                # Report the time that the world has reached, which lags behind the current time if this process was
                # delayed.
                on_tick(max(bus.reached_s for bus in buses.values()))


class Emulator:
    """One bus on one pseudo-terminal. ``turn`` performs all work that is due and never waits."""

    def __init__(self, bus: ServoLine[Any], line: PtyAdapter | PtyLink, clock: Clock) -> None:
        self._bus = bus
        self._line = line
        self._clock = clock
        self._coming: deque[DelayedReply] = deque()
        self._next_tick_s = clock.now()
        bus.advance(clock.now())

    def patience_s(self) -> float:
        """Return the time until the next scheduled work, in seconds. A client may send bytes before then."""
        due_s = min(self._next_tick_s, self._burst_end_s()) if self._coming else self._next_tick_s
        return max(0.0, due_s - self._clock.now())

    def turn(self) -> None:
        """Send the replies that are due, reply to new instructions, and advance the physics."""
        if self._coming and self._burst_end_s() <= self._clock.now():
            self._send_burst()
        data = self._line.read()
        now_s = self._clock.now()
        if data or now_s >= self._next_tick_s:
            self._bus.advance(now_s, LONGEST_CATCH_UP_S)
            self._next_tick_s = now_s + TICK_S
        if data:
            self._coming += self._bus.receive(data, now_s, self._line.baud)

    def _burst_length(self) -> int:
        """Return the number of pending replies to deliver together."""
        coming = self._coming
        length = 1
        while length < len(coming) and (coming[length].due_s - coming[length - 1].due_s < USB_FRAME_S):
            length += 1
        return length

    def _burst_end_s(self) -> float:
        return self._coming[self._burst_length() - 1].due_s

    def _send_burst(self) -> None:
        replies = [self._coming.popleft() for _ in range(self._burst_length())]
        self._line.write(b"".join(reply.data for reply in replies))
