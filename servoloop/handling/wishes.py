"""What a button that is held asks of the arm."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol


class Moves(Protocol):
    """What moves the arm: nodes.handling.robot_client.RobotClient."""

    def jog(self, joint: str, share: float) -> None: ...
    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool: ...
    def stop(self) -> None: ...


class Wish(Protocol):
    """A motion that goes on as long as it is wished."""

    def on(self, client: Moves) -> str:
        """Go on a little; in words what is done. Raises HandlingError where the arm cannot be moved."""
        ...


@dataclass(frozen=True, slots=True)
class Turn:
    """A joint turns, at this share (-1 to 1) of its full speed."""

    joint: str
    share: float

    def on(self, client: Moves) -> str:
        """Turn on a little."""
        client.jog(self.joint, self.share)
        return f"{self.joint} turns {'on' if self.share > 0 else 'back'}"


@dataclass(frozen=True, slots=True)
class GoTo:
    """The joints of a pose (rad or m) go there, at this share (0 to 1) of full speed."""

    name: str
    pose: Mapping[str, float]
    share: float

    def on(self, client: Moves) -> str:
        """Go on a little."""
        return f"there: {self.name}" if client.approach(self.pose, self.share) else f"on the way: {self.name}"
