"""Move an SO-101 through three poses and back. Run: python three_poses.py [PORT]"""

import sys

from servoloop import Arm

READY = {"shoulder_pan": 0.0, "shoulder_lift": -1.2, "elbow_flex": 0.5, "wrist_flex": 0.8, "wrist_roll": 0.0}
POSES = {
    "ready": READY,
    "left": READY | {"shoulder_pan": 0.6},
    "stretched": READY | {"shoulder_lift": -0.6, "elbow_flex": 0.0},
}


def main(arm: Arm) -> None:
    for name, pose in POSES.items():
        arm.move_to(pose, duration=2.0)
        position = arm.state.position
        off = max(abs(position[joint] - target) for joint, target in pose.items())
        print(f"{name}: reached within {off:.3f} rad")
    arm.move_to(READY, speed=0.3)


if __name__ == "__main__":
    with Arm("so101", *sys.argv[1:2]) as so101:  # without a port, virtual servos are used
        main(so101)
