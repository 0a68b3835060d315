"""Close the gripper until it presses with a chosen load. Run: python grip_by_load.py [PORT]"""

import sys

from servoloop import Arm

LOAD_NM = 0.25
"""Torque at which the object counts as held, in N m."""
CYCLES = 3
"""Number of cycles for which the load must last, because a servo also needs a high torque when it starts to move."""


def main(arm: Arm) -> bool:
    arm.gripper.open()
    motion = arm.gripper.close(speed=0.1, wait=False)
    loaded = 0
    while not motion.done and loaded < CYCLES:
        effort = abs(arm.step().effort[arm.gripper.joint])
        loaded = loaded + 1 if effort > LOAD_NM else 0
    motion.cancel()  # the gripper stays at its position and holds the object
    arm.step()
    held = loaded == CYCLES
    print(f"{'holding' if held else 'closed'} at {arm.state.position[arm.gripper.joint]:.3f} rad")
    return held


if __name__ == "__main__":
    with Arm("so101", *sys.argv[1:2]) as so101:
        main(so101)
