"""Record a motion that you show by hand, and then let the arm repeat it. Run: python teach_and_replay.py PORT"""

import sys

from servoloop import Arm, ArmState, ArmTrajectory


def record(arm: Arm) -> list[ArmState]:
    """Release the torque and record the states until Enter is pressed."""
    input("The arm parks and releases its torque. Press Enter when you are ready.")
    arm.torque(False)
    states: list[ArmState] = []
    end = arm.on_state(states.append)
    input("Move the arm by hand. Hold it still and press Enter when you have finished.")
    end()
    arm.torque(True)  # the servos hold the arm in the pose in which your hand holds it
    return states


def main(arm: Arm) -> None:
    trajectory = ArmTrajectory.recorded(record(arm), arm.limits)
    print(f"recorded {trajectory.times_s[-1]:.1f} s")
    input("Take your hands off. Press Enter to replay the motion.")
    arm.follow(trajectory)


if __name__ == "__main__":
    with Arm("so101", *sys.argv[1:2]) as so101:
        main(so101)
