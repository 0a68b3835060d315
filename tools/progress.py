"""Show the progress of a long setup: one live line on a terminal, or a line every ten seconds in a file."""

import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from shutil import get_terminal_size
from typing import TextIO

TICK_S = 0.2
QUIET_S = 10.0  # Time between two lines in a log file, in seconds.


class SetUpStep:
    """One of `total` numbered steps: `with SetUpStep(1, 4, "packages") as step: step.follow(futures, detail)`."""

    def __init__(self, number: int, total: int, title: str, out: TextIO = sys.stdout) -> None:
        self.head = f"[{number}/{total}] {title:<18}"
        self.out = out
        self.live = out.isatty()
        self.began_s = self.said_s = time.monotonic()

    def __enter__(self) -> "SetUpStep":
        self._show("")
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._show("done" if kind is None else "stopped", last=True)

    def follow(self, futures: list[Future[None]], detail: Callable[[], str]) -> None:
        """Show `detail()` until all futures are done or one has failed, and raise its error."""
        pending = set(futures)
        while pending:
            done, pending = wait(pending, timeout=TICK_S)
            for future in done:
                future.result()
            if self.live or time.monotonic() - self.said_s > QUIET_S:
                self._show(detail())

    def _show(self, text: str, last: bool = False) -> None:
        self.said_s = time.monotonic()
        line = f"{self.head} {self.said_s - self.began_s:4.0f} s  {text}".rstrip()
        if self.live:
            line = "\r\033[K" + line[: get_terminal_size().columns - 1]
        self.out.write(line if self.live and not last else line + "\n")
        self.out.flush()
