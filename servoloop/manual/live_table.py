"""A table that lives in a terminal; elsewhere a line for each change of what is said."""

from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console, RenderableType
from rich.live import Live


class LiveTable:
    """A context manager: the table stays while it lasts, below the lines that are said."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, refresh_per_second=8, transient=True) if console.is_terminal else None
        self._said = ""

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def draw(self, text: str, table: Callable[[], RenderableType]) -> None:
        """Say ``text``, once until it changes, and show the table."""
        if text != self._said:
            self._said = text
            self._console.print(f"[dim]·[/] {text}", highlight=False)
        if self._live is not None:
            self._live.update(table())
