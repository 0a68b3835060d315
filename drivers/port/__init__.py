"""Interface of ports, which serial devices and the virtual bus implement."""

from typing import Protocol


class Port(Protocol):
    """Half-duplex serial port with one owner.

    All methods raise ``PortLost`` after the device has disappeared, for example because the adapter was unplugged.
    """

    @property
    def name(self) -> str:
        """Name of the port for messages, such as ``/dev/ttyACM0``."""
        ...

    @property
    def baud(self) -> int:
        """Baud rate, in bits per second. Each byte takes ten bits (8N1)."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes.

        Args:
            data: The bytes to send. All of the bytes are sent.
        """
        ...

    def read(self, size: int, deadline_s: float) -> bytes:
        """Wait until ``size`` bytes have arrived or the deadline has passed. Waiting does not use the processor.

        Args:
            size: Number of bytes to wait for.
            deadline_s: Time to stop waiting, in seconds on the port's clock.

        Returns:
            The bytes that have arrived: at most ``size``, possibly none.
        """
        ...

    def discard_input(self) -> None:
        """Discard all received bytes that have not been read."""
        ...

    def set_baud(self, baud: int) -> None:
        """Change the baud rate.

        Args:
            baud: New rate, in bits per second.

        Raises:
            PortError: The adapter does not support the rate. The port keeps its previous rate.
        """
        ...

    def close(self) -> None:
        """Close the port. A second call has no effect."""
        ...
