"""What can be made to go wrong on the virtual wire."""


class WireFaults:
    """Switches that the bus looks at whenever a servo is about to reply. Servos are named by ID."""

    def __init__(self) -> None:
        self._silent: set[int] = set()
        self._corrupt: dict[int, int] = {}

    def silence(self, servo_id: int) -> None:
        """The servo's data line breaks: it neither hears nor answers until ``restore``."""
        self._silent.add(servo_id)

    def restore(self, servo_id: int) -> None:
        """Mend what ``silence`` broke."""
        self._silent.discard(servo_id)

    def corrupt_next(self, servo_id: int, replies: int = 1) -> None:
        """The next replies of the servo arrive with a wrong checksum."""
        self._corrupt[servo_id] = self._corrupt.get(servo_id, 0) + replies

    def is_silent(self, servo_id: int) -> bool:
        """Whether the servo is cut off."""
        return servo_id in self._silent

    def pass_reply(self, servo_id: int, packet: bytes) -> bytes:
        """A reply as it comes out of the wire."""
        left = self._corrupt.get(servo_id, 0)
        if not left:
            return packet
        self._corrupt[servo_id] = left - 1
        return packet[:-1] + bytes((packet[-1] ^ 0xFF,))
