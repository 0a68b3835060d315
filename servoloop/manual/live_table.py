"""Table that is updated in place in a terminal. If the output is not a terminal, only messages are printed."""

from collections.abc import Callable
from typing import Self

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text


class LiveTable:
    """Context manager that shows a table below the printed messages."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, refresh_per_second=8, transient=True) if console.is_terminal else None
        self._message = ""

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def say(self, text: str, style: str = "") -> None:
        """Print a line above the table. Text that is printed in another way would be overwritten by the table."""
        self._console.print(Text(text, style), soft_wrap=True)

    def draw(self, text: str, table: Callable[[], RenderableType]) -> None:
        """Print ``text`` if it has changed, and update the table."""
        if text != self._message:
            self._message = text
            self._console.print(Text.assemble(("· ", "dim"), text))
        if self._live is not None:
            self._live.update(table())
