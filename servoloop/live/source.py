"""The source of what is shown: a running stack, or a recording that is played."""

from typing import Protocol

from servoloop.live.watched import Watched


class Source(Protocol):
    """Where a robot's state comes from."""

    @property
    def watched(self) -> Watched:
        """The robot as it is now."""
        ...

    @property
    def status(self) -> str:
        """What is shown: a running stack, a recording, or that the stack has ended."""
        ...

    @property
    def well(self) -> bool:
        """Whether what is shown is what the status promises, and no state that has been left behind."""
        ...

    def close(self) -> None:
        """End."""
        ...
