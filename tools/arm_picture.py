"""The pictures of the arms in docs/: a still or a film of a simulated job.

Example: `python tools/arm_picture.py so101 docs/arms/so101.png`, `python tools/arm_picture.py robot_arm docs/arm.gif`
"""

import sys
from pathlib import Path

from servoloop.arms.folder import find_arm, read_arm_files
from servoloop.arms.pick_place import load_pick_place
from servoloop.simulation.job import run_job
from servoloop.simulation.simulate import SETTLED_S
from servoloop.simulation.stack import SimulatedStack
from sim_backend.mechanics.build import Build
from sim_backend.scene.picture import Recorder

GRADE = {"koch": "B"}
"""The bin to which the arm carries its cube, where that is not A."""


def main(name: str, picture: Path) -> None:
    """Let the arm carry a cube; draw it with the cube at its highest, or as a film where the name ends in .gif."""
    arm = find_arm(name)
    stack = SimulatedStack(files=read_arm_files(arm), build=Build(backlash_deg=1.0)).up()
    stack.run(SETTLED_S)
    recorder = Recorder(stack.world)
    stack.on_step = recorder.update
    job = run_job(stack, load_pick_place(arm.pick_place).settings(), GRADE.get(name, "A"))
    assert job.success, job.message
    (recorder.save_film if picture.suffix == ".gif" else recorder.save_still)(picture)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
