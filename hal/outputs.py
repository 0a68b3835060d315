"""Values of a robot's outputs, which controllers set and hardware components send."""

import math
from collections.abc import Mapping

from hal.robot_description.outputs import OutputInfo


class Outputs:
    """Requested value of each output, keyed by interface (``lamp/led``). This class is used only by the loop's
    thread."""

    def __init__(self, infos: Mapping[str, OutputInfo] | None = None) -> None:
        """Start with the initial values of the outputs."""
        self.infos = dict(infos or {})
        """Outputs, keyed by interface."""
        self.values = {name: info.initial for name, info in self.infos.items()}
        """Requested values, keyed by interface; NaN before the first command."""

    def set(self, name: str, value: float) -> None:
        """Request a value. The value is clamped to the output's range."""
        info = self.infos[name]
        self.values[name] = min(max(value, info.lowest), info.highest)

    def requested(self, name: str) -> float | None:
        """Return the requested value of an output, or None before the first command."""
        value = self.values.get(name, math.nan)
        return None if math.isnan(value) else value
