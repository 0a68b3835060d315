"""The commands that mend one servo, as a user types them."""

from commissioning.doctor.snapshot import ServoSnapshot


def write(servo: ServoSnapshot, name: str, value: int) -> str:
    """Write one register."""
    return f"servoloop register write --port {servo.port} --id {servo.joint.servo_id} {name} {value}"


def show(servo: ServoSnapshot) -> str:
    """Show the whole table."""
    return f"servoloop register list --port {servo.port} --id {servo.joint.servo_id}"


def let_go(servo: ServoSnapshot) -> str:
    """Switch its torque off."""
    return write(servo, "torque_enable", 0)


def on(port: str, verb: str, *arguments: int | str) -> str:
    """A verb for one servo."""
    return " ".join(("servoloop", verb, *map(str, arguments), "--port", port))
