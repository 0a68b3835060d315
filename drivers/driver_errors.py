"""Port and servo errors.

Setup calls raise these errors. The control cycle returns the fault of a servo as a value instead.
"""


class DriverError(Exception):
    """Base class of all errors in this package. The message tells the user what to do."""


class PortError(DriverError):
    """Error of a serial port."""


class PortMissing(PortError):
    """The device does not exist."""


class PortNotSerial(PortError):
    """The path is not a serial device."""


class PortBusy(PortError):
    """Another program has the device open, or this program has it open already."""


class PortDenied(PortError):
    """The user has no permission to open the device."""


class PortLost(PortError):
    """The device disappeared while it was open."""


class ServoError(DriverError):
    """Error of the servo with ID ``servo_id``."""

    def __init__(self, servo_id: int, text: str) -> None:
        super().__init__(f"servo {servo_id}: {text}")
        self.servo_id = servo_id
        self.text = text


class ServoSilent(ServoError):
    """The servo did not reply before the deadline."""


class ServoCorrupt(ServoError):
    """The reply has a wrong checksum or length."""


class ServoRefused(ServoError):
    """The servo replied, but rejected the request or is not the expected servo."""
