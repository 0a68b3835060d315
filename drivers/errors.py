"""Everything that can go wrong below the joints: the line itself, or one servo, which is named by its ID.

Set-up raises these. The cycle does not: there a servo's error is a value beside the others' values.
"""


class DriverError(Exception):
    """Base of all errors of this package. The text says what to do."""


class PortError(DriverError):
    """The line to the servos."""


class PortMissing(PortError):
    """There is no such device."""


class PortNotSerial(PortError):
    """The path is not a serial device."""


class PortBusy(PortError):
    """Another program holds the device, or this one a second time."""


class PortDenied(PortError):
    """The user may not open the device."""


class PortLost(PortError):
    """The device was open and is gone."""


class ServoError(DriverError):
    """One servo's trouble; ``servo_id`` tells which."""

    def __init__(self, servo_id: int, text: str) -> None:
        super().__init__(f"servo {servo_id}: {text}")
        self.servo_id = servo_id
        self.text = text


class ServoSilent(ServoError):
    """No reply before the deadline."""


class ServoCorrupt(ServoError):
    """A reply with a wrong checksum or length."""


class ServoRefused(ServoError):
    """The servo answered, but refused or is not the one that was expected."""
