"""The interface of ports. Serial devices and the virtual bus implement it."""

from typing import Protocol


class Port(Protocol):
    """A half-duplex serial port with one owner.

    All methods raise ``PortLost`` after the device has disappeared, such as an unplugged adapter.
    """

    @property
    def name(self) -> str:
        """Name of the port for messages, such as ``/dev/ttyACM0``."""
        ...

    @property
    def baud(self) -> int:
        """Baud rate, in bits per second. A byte takes ten bits (8N1)."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""
        ...

    def read(self, size: int, deadline_s: float) -> bytes:
        """Read bytes until a deadline, without busy-waiting.

        Args:
            size: Number of bytes to wait for.
            deadline_s: Time on the clock at which to stop waiting, in seconds.

        Returns:
            The bytes received by then: at most ``size`` bytes, possibly none.
        """
        ...

    def discard_input(self) -> None:
        """Discard all received bytes that have not been read."""
        ...

    def set_baud(self, baud: int) -> None:
        """Change the baud rate. Raise PortError and keep the old rate if the adapter does not support the new rate."""
        ...

    def close(self) -> None:
        """Close the port. Closing it again has no effect."""
        ...
