"""Components whose measurements and commands can be observed, by invariants and by traces of a simulated run."""

from collections.abc import Callable

from hal.components.component_set import ComponentSet
from hal.types import FloatArray, JointState


class ObservedComponents(ComponentSet):
    """Set of components that calls observers in each cycle, even while the program exits."""

    on_read: Callable[[JointState], None] | None = None
    """Function called with each measurement."""
    on_command: Callable[[FloatArray], None] | None = None
    """Function called with each command before it is written."""
    on_written: Callable[[], None] | None = None
    """Function called after each command is written."""

    def read(self, deadline_s: float | None = None) -> JointState:
        """Read all components, as in ComponentSet, and call ``on_read``."""
        state = super().read(deadline_s)
        if self.on_read is not None:
            self.on_read(state)
        return state

    def write(self, values: FloatArray, period_s: float) -> None:
        """Write the commands as ComponentSet does. Call ``on_command`` before and ``on_written`` after the write."""
        if self.on_command is not None:
            self.on_command(values)
        super().write(values, period_s)
        if self.on_written is not None:
            self.on_written()
