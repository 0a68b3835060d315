"""Parameters and the inbox of the forward command controllers of all interfaces.

Other than upstream, a message of the wrong length is dropped and the controller stays active: one bad message must
not let go of the hand. ``deactivate_on_wrong_length`` brings upstream's way back.
"""

from collections import deque
from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from controller.parameters import Parameters
from hal.plausible import Time
from hal.types import FloatArray

COMMAND_TIMEOUT_S = 0.5
"""Seconds for which a velocity or an effort holds without a new message, unless the file says otherwise."""


class ForwardParameters(Parameters):
    """Parameters of a forward command controller."""

    joints: tuple[str, ...] = Field(min_length=1)
    interface_name: Literal["position", "velocity", "effort"]
    command_timeout: Time = COMMAND_TIMEOUT_S
    """Seconds after which a velocity or an effort without a new message falls to 0; 0: never, as upstream."""
    deactivate_on_wrong_length: bool = False

    def claims(self) -> tuple[str, ...]:
        return tuple(f"{joint}/{self.interface_name}" for joint in self.joints)

    def unused(self) -> list[str]:
        idle = self.interface_name == "position" and "command_timeout" in self.model_fields_set
        return super().unused() + (["command_timeout (a position is held)"] if idle else [])


class Inbox:
    """The inbox holds the newest command, handed over from any thread."""

    def __init__(self, joints: Sequence[str], strict: bool = False) -> None:
        """``strict``: a message of the wrong length makes ``take`` raise."""
        self._joints = tuple(joints)
        self._strict = strict
        self._commands: deque[FloatArray | str] = deque(maxlen=1)

    def submit(self, values: Sequence[float]) -> str | None:
        """Returns why a command is dropped, or None; an empty one means nothing."""
        if not values:
            return None
        if len(values) != len(self._joints):
            return self._wrong_length(len(values))
        if not np.isfinite(values).all():
            return "Non-finite value received. Dropping message"
        self._commands.append(np.array(values, dtype=np.float64))
        return None

    def take(self) -> FloatArray | None:
        """The command since the last time, shape (n,). Raises ValueError where upstream does, if strict."""
        newest = self._commands.popleft() if self._commands else None
        if isinstance(newest, str):
            raise ValueError(newest)
        return newest

    def clear(self) -> None:
        """Drop commands from before an activation or a deactivation."""
        self._commands.clear()

    def __bool__(self) -> bool:
        return bool(self._commands)

    def _wrong_length(self, length: int) -> str:
        text = f"command size ({length}) does not match number of interfaces ({len(self._joints)})"
        if self._strict:
            self._commands.append(text)
        return f"{text}: dropped, send one value for each of {', '.join(self._joints)}"
