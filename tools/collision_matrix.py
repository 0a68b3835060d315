"""Print the pairs of links that MoveIt need not check, as <disable_collisions> elements for the SRDF of an arm.

python tools/collision_matrix.py                               # the default arm
python tools/collision_matrix.py so101                         # an arm that `servoloop arms` lists
python tools/collision_matrix.py ./my_arm --samples 1000000    # an arm folder, with more random poses
"""

import argparse
import sys

from hal.hal_errors import ArmFileError
from servoloop.motion_planning.collision_matrix import SAMPLES, SEED, lines, reasons
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.shipped_files import OWN


def main() -> None:
    parser = argparse.ArgumentParser(description="Print an SRDF's self-collision matrix.")
    parser.add_argument("arm", nargs="?", default=OWN, help="an arm that `servoloop arms` lists, or its folder")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="number of random poses")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the random poses")
    arguments = parser.parse_args()
    try:
        scene = find_arm(arguments.arm).scene
        print("\n".join(lines(reasons(scene, arguments.samples, arguments.seed))))
    except (ArmFileError, ValueError) as error:  # ValueError is raised if MuJoCo cannot read the scene
        sys.exit(f"{arguments.arm}: {error}")


if __name__ == "__main__":
    main()
