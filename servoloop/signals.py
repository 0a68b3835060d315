"""SIGINT and SIGTERM as a count: the first asks for a calm end, the second for a quick one."""

import signal
from types import FrameType, TracebackType


class Signals:
    """A context manager; the former handlers come back at its end."""

    def __init__(self) -> None:
        self.count = 0
        self._former: dict[int, object] = {}

    def __enter__(self) -> "Signals":
        for number in (signal.SIGINT, signal.SIGTERM):
            self._former[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, handler in self._former.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def ask(self) -> None:
        """Ask for the end as the first signal does."""
        self.count = max(self.count, 1)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
