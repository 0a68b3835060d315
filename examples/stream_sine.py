"""Stream targets at 50 Hz, as a learned policy does. Run: python stream_sine.py [PORT]"""

import math
import sys

from servoloop import Arm

READY = {"shoulder_pan": 0.0, "shoulder_lift": -1.2, "elbow_flex": 0.5, "wrist_flex": 0.8}
RATE_HZ = 50
SECONDS = 4.0


def policy(time_s: float) -> dict[str, float]:
    """Return the targets for this time. A real policy would use camera images and ``arm.state``."""
    return {"shoulder_pan": 0.4 * math.sin(2.0 * math.pi * 0.5 * time_s)}


def main(arm: Arm) -> None:
    arm.move_to(READY, duration=2.0)
    with arm.stream(max_age=0.2) as stream:  # the arm stops if no target arrives for 0.2 s
        begun_s = arm.state.time_s
        for number in range(int(SECONDS * RATE_HZ)):
            stream.send(policy(number / RATE_HZ))
            arm.sleep(1.0 / RATE_HZ)
    print(f"streamed for {arm.state.time_s - begun_s:.1f} s")


if __name__ == "__main__":
    with Arm("so101", *sys.argv[1:2]) as so101:
        main(so101)
