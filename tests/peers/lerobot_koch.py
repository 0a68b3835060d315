"""LeRobot's Dynamixel bus class on virtual servos, with the settings that LeRobot gives a Koch.

Run this file with the Python of an environment that has LeRobot, and with the port as its argument.
"""

import importlib
import sys
import time
from typing import Any

motors: Any = importlib.import_module("lerobot.motors")
dynamixel: Any = importlib.import_module("lerobot.motors.dynamixel")
MODELS = {
    "shoulder_pan": "xl430-w250",
    "shoulder_lift": "xl430-w250",
    "elbow_flex": "xl330-m288",
    "wrist_flex": "xl330-m288",
    "wrist_roll": "xl330-m288",
    "gripper": "xl330-m288",
}
IDS = dict(zip(MODELS, range(1, 7), strict=True))
RANGE = (700, 3400)
ARRIVE_S = 20.0
"""Maximum time of a motion on a busy machine, in seconds."""
RETRIES = 20
"""A busy machine loses replies, and the class repeats a request only if its caller asks for it."""


def write(bus: Any, name: str, motor: str, value: int) -> None:
    bus.write(name, motor, value, normalize=False, num_retry=RETRIES)


def read(bus: Any, name: str) -> dict[str, int]:
    values: dict[str, int] = bus.sync_read(name, normalize=False, num_retry=RETRIES)
    return values


def calibrate(bus: Any) -> dict[str, Any]:
    """Make the current pose the middle position of all motors, as ``KochFollower.calibrate`` does."""
    bus.disable_torque(num_retry=RETRIES)
    for motor in MODELS:
        write(bus, "Operating_Mode", motor, dynamixel.OperatingMode.EXTENDED_POSITION.value)
    offsets = bus.set_half_turn_homings()
    lowest, highest = RANGE
    calibration = {m: motors.MotorCalibration(IDS[m], 0, offsets[m], lowest, highest) for m in MODELS}
    bus.write_calibration(calibration)
    return calibration


def near(positions: dict[str, int], goals: dict[str, int]) -> bool:
    """Return whether all positions are within 40 counts of their goals."""
    return all(abs(positions[motor] - goal) <= 40 for motor, goal in goals.items())


def check(bus: Any) -> None:
    """Calibrate the arm, configure it as LeRobot does, and move it."""
    calibration = calibrate(bus)
    assert bus.read_calibration() == calibration
    assert bus.is_calibrated
    with bus.torque_disabled():
        bus.configure_motors()
        for motor in MODELS:
            mode = "CURRENT_POSITION" if motor == "gripper" else "EXTENDED_POSITION"
            write(bus, "Operating_Mode", motor, dynamixel.OperatingMode[mode].value)
        for name, value in (("Position_P_Gain", 1500), ("Position_I_Gain", 0), ("Position_D_Gain", 600)):
            write(bus, name, "elbow_flex", value)
    assert read(bus, "Torque_Enable") == dict.fromkeys(MODELS, 1)
    for shift in (400, -600, 0):
        goals = {motor: 2047 + shift + 10 * i for motor, i in IDS.items()}
        bus.sync_write("Goal_Position", goals, normalize=False)
        deadline_s = time.monotonic() + ARRIVE_S
        while not near(read(bus, "Present_Position"), goals):
            assert time.monotonic() < deadline_s, f"the arm is at {read(bus, 'Present_Position')}, not at {goals}"


def main() -> None:
    """Run the check on the servos at a port."""
    norm = motors.MotorNormMode.RANGE_M100_100
    bus = dynamixel.DynamixelMotorsBus(
        port=sys.argv[1], motors={name: motors.Motor(IDS[name], model, norm) for name, model in MODELS.items()}
    )
    bus.connect()
    try:
        check(bus)
    finally:
        bus.disconnect(disable_torque=False)
    print("the Koch has reached its goals")


if __name__ == "__main__":
    main()
