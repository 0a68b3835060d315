"""Define the parameters and the command inbox of the forward command controllers.

Unlike in ros2_control, a message of the wrong length is dropped and the controller stays active, so that one invalid
message does not interrupt the control of the joints. ``deactivate_on_wrong_length`` restores ros2_control's behavior.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from controller.parameters import Parameters
from hal.plausible import Time
from hal.types import FloatArray

COMMAND_TIMEOUT_S = 0.5
"""Default maximum time for which a velocity or an effort remains valid without a new message, in seconds."""


class ForwardParameters(Parameters):
    """Parameters of a forward command controller."""

    joints: tuple[str, ...] = Field(min_length=1)
    interface_name: str = Field(min_length=1)
    command_timeout: Time = COMMAND_TIMEOUT_S
    """Time after which a velocity or an effort without a new message becomes 0, in seconds.

    0 disables the timeout, as in ros2_control.
    """
    deactivate_on_wrong_length: bool = False

    def claims(self) -> tuple[str, ...]:
        return tuple(f"{joint}/{self.interface_name}" for joint in self.joints)

    def unused(self) -> list[str]:
        idle = self.interface_name == "position" and "command_timeout" in self.model_fields_set
        return super().unused() + (["command_timeout (positions have no timeout)"] if idle else [])


class Inbox:
    """Inbox for the latest command. Any thread may submit a command."""

    def __init__(self, joints: Sequence[str], strict: bool = False) -> None:
        """Create an empty inbox. If ``strict`` is true, ``take`` raises an error after a message of the wrong
        length."""
        self._joints = tuple(joints)
        self._strict = strict
        self._commands: deque[FloatArray | str] = deque(maxlen=1)

    def submit(self, values: Sequence[float]) -> str | None:
        """Submit a command. Return None, or the reason why the command was dropped. An empty command is ignored."""
        if not values:
            return None
        if len(values) != len(self._joints):
            return self._wrong_length(len(values))
        if not np.isfinite(values).all():
            return "Non-finite value received. Dropping message"
        self._commands.append(np.array(values, dtype=np.float64))
        return None

    def take(self) -> FloatArray | None:
        """Return the command (n,) submitted since the last call, or None.

        A strict inbox raises ValueError for a command of the wrong length.
        """
        newest = self._commands.popleft() if self._commands else None
        if isinstance(newest, str):
            raise ValueError(newest)
        return newest

    def clear(self) -> None:
        """Drop the pending command, because the controller is being activated or deactivated."""
        self._commands.clear()

    def __bool__(self) -> bool:
        return bool(self._commands)

    def _wrong_length(self, length: int) -> str:
        text = f"command size ({length}) does not match number of interfaces ({len(self._joints)})"
        if self._strict:
            self._commands.append(text)
        result = "the controller is deactivated" if self._strict else "the command is dropped"
        return f"{text}: {result}. Send one value for each of {', '.join(self._joints)}"
