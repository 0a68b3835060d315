"""Display the state of the arm, its joints and its faults during a recording or playback."""

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Self

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from servoloop.api.arm import Arm
from servoloop.api.backend import ArmState
from servoloop.manual.live_table import LiveTable
from servoloop.stack.terminal import raw_keys, typed


class ArmScreen(LiveTable):
    """Live table of one arm."""

    def show(self, phase: str, arm: Arm) -> None:
        """Display the current state."""
        state = arm.state
        text = "; ".join([phase, *dict.fromkeys(state.faults.values())])
        self.draw(text, lambda: Group(Text(phase, style="cyan"), _table(state)))


class Teacher(ArmScreen):
    """Terminal user interface of a recording."""

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._raw = ExitStack()

    def __enter__(self) -> Self:
        if sys.stdin.isatty():
            self._raw.enter_context(raw_keys())
        return super().__enter__()

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._raw.close()

    def pressed(self) -> Sequence[str]:
        """Return the keys pressed since the last call.

        If input is not a terminal, it is read line by line, and the end of the input is treated as q.
        """
        return typed(0.0)


def _table(state: ArmState) -> Table:
    table = Table("joint", "measured", "commanded")
    for name, position in state.position.items():
        style = "red" if name in state.faults else ""
        table.add_row(name, f"{position:+.3f}", f"{state.command[name]:+.3f}", style=style)
    return table
