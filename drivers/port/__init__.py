"""The first seam: where bytes leave. A real serial device and the virtual bus are both a Port."""

from typing import Protocol


class Port(Protocol):
    """A half-duplex byte line with one owner.

    Every method raises ``PortLost`` once the line is gone (unplugged adapter, ended emulator).
    """

    @property
    def name(self) -> str:
        """What to call the line in a message, e.g. ``/dev/ttyACM0``."""
        ...

    @property
    def baud(self) -> int:
        """Bits per second; a byte takes ten of them (8N1)."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""
        ...

    def read(self, size: int, deadline_s: float) -> bytes:
        """Wait without spinning until ``size`` bytes are there or the clock says ``deadline_s``.

        Returns what has come by then: at most ``size`` bytes, perhaps none.
        """
        ...

    def discard_input(self) -> None:
        """Drop whatever was received and not yet read."""
        ...

    def set_baud(self, baud: int) -> None:
        """Change the rate. Raises PortError, and keeps the old one, where the adapter does not know it."""
        ...

    def close(self) -> None:
        """Give the line back. Closing twice is no error."""
        ...
