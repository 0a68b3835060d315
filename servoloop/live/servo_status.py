"""What /diagnostics says of servos, found by joint."""

from typing import Final

from servoloop.live.robot_state import Snapshot, StatusNow

OWN: Final = "servoloop: "
OF_SERVO: Final = " (servo "
FAULT: Final = 2
"""The level of an error."""


def servo_status(snapshot: Snapshot, joint: str) -> StatusNow | None:
    """The status of a joint's servo; None where it has none."""
    prefix = f"{OWN}{joint}{OF_SERVO}"
    return next((status for name, status in snapshot.statuses.items() if name.startswith(prefix)), None)


def servo_faults(snapshot: Snapshot) -> dict[str, str]:
    """What is wrong with servos, by joint."""
    said = {joint: servo_status(snapshot, joint) for joint in snapshot.joints}
    return {joint: one.message for joint, one in said.items() if one is not None and one.level >= FAULT}
