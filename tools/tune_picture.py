"""Draw the image of docs/tune.md: the shoulder of an SO-101 in simulated time, with half and full factory P gain.

Example: `python tools/tune_picture.py docs/tune.svg`
"""

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from commissioning.tune.report import tune
from commissioning.tune.tuner import Ending, Tuner
from drivers.bus.bus import Bus
from drivers.servos import sts
from hal.joint import Joint
from servoloop.commands.output.tune_picture import picture
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import Build
from sim_backend.clock import SimulatedClock

ARM, JOINT, AT = "so101", "shoulder_lift", 0.9
POSE: Final = {"shoulder_lift": 0.6, "elbow_flex": -0.6}
SOFT, FACTORY = 16, 32


def main(path: Path) -> None:
    """Measure with one gain, write the other gain, measure again, and draw both curves."""
    files, clock = read_arm_files(find_arm(ARM)), SimulatedClock()
    joints = files.robot.joints
    lines = VirtualLines(files, Build(), [POSE.get(joint.name, 0.0) for joint in joints])
    (line,) = lines.lines.values()
    servo_id = next(joint.servo_id for joint in joints if joint.name == JOINT)
    line.servo(servo_id).memory.save(sts.position_p, SOFT)
    park = files.robot.file.park
    ending = Ending(relax=True, park=park.pose if park else None)
    tuner = Tuner(joints, JOINT, partial(_opened, lines, clock), clock, ending)
    report = tune(tuner, AT, write={"P": FACTORY})
    path.write_text(picture(report))


def _opened(lines: VirtualLines, clock: SimulatedClock, joints: Sequence[Joint]) -> Mapping[str, Bus]:
    models = {joint.servo_id: joint.model for joint in joints}
    return {name: Bus(lines.open(name, 1_000_000, clock), clock, models) for name in lines.lines}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
