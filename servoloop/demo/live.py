"""The demo's live view: phase, joints, loop timing, temperatures and voltages."""

from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live as RichLive
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from nodes.stack_monitor import NewestMessages


class Live:
    """A live view on a terminal; elsewhere one line an event."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._view = RichLive(console=console, refresh_per_second=8, transient=True)
        self._job = ""
        self._phase = ""

    def __enter__(self) -> "Live":
        if self.console.is_terminal:
            self._view.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._view.stop()

    def say(self, what: str) -> None:
        """Print one line of progress."""
        self.console.print(f"[dim]·[/] {what}")

    def job(self, grade: str) -> None:
        """JobRunner that a job begins."""
        self._job, self._phase = f"grade {grade}", ""

    def phase(self, phase: str, message: str) -> None:
        """JobRunner the node's feedback."""
        self._phase = phase
        if not self.console.is_terminal:
            self.say(f"{self._job}: {phase}")

    def done(self, grade: str, where: str | None, success: bool, message: str) -> None:
        """Print how a job has ended."""
        mark = "[green]✓[/]" if success else "[red]✗[/]"
        place = f"bin {where}" if where else "no bin"
        self.console.print(f"{mark} grade {grade}: cube in {place} [dim]{message}[/]")
        self._job, self._phase = "", ""

    def show(self, newest: "NewestMessages") -> None:
        """JobRunner the newest state."""
        if self.console.is_terminal:
            self._view.update(self._render(newest))

    def _render(self, newest: "NewestMessages") -> Group:
        title = Text.assemble((self._job or "idle", "bold"), "  ", (self._phase, "cyan"))
        return Group(title, _joints(newest), _loop_line(newest))


def _joints(newest: "NewestMessages") -> Table:
    table = Table("joint", *("position", "velocity", "following error", "°C", "V", "servo"))
    for column in table.columns[1:6]:
        column.justify = "right"
    for name, position in newest.position.items():
        servo = newest.servo(name)
        if not servo:
            continue
        error = newest.error.get(name)
        table.add_row(
            name,
            f"{position:+.4f}",
            f"{newest.velocity.get(name, 0.0):+.3f}",
            "" if error is None else f"{error:+.4f}",
            servo.get("temperature_c", ""),
            servo.get("voltage_v", ""),
            servo.get("message", ""),
        )
    return table


def _loop_line(newest: "NewestMessages") -> Text:
    loop = newest.loop
    if not loop:
        return Text("waiting for the loop's figures")
    return Text(
        f"{loop['rate_hz']} Hz   cycles {loop['cycles']}   missed {loop['missed_cycles']}   "
        f"unmeasured {loop['unmeasured_cycles']}   "
        f"latest wake-up {loop['latest_wake_up_ms']} ms   mean cycle {loop['mean_cycle_ms']} ms"
    )
