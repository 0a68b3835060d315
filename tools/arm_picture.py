"""Draw the images of the arms in docs/: either an image of a simulated job, or a video of an arm that sorts three
cubes.

Example: `python tools/arm_picture.py koch docs/arms/koch.png`, `python tools/arm_picture.py so101 docs/arm.gif`
"""

import sys
from pathlib import Path

from servoloop.simulation.job import run_job
from servoloop.simulation.simulate import SETTLED_S
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import load_pick_place
from sim_backend.buses.build import Build
from sim_backend.scene.picture import FilmRecorder

GRADE = {"koch": "B"}
"""Grade of the cube, keyed by arm name. For all other arms, the grade is A."""

PERIOD_S = 0.4
"""Simulated time between two frames of a video, in seconds."""
FRAMES = 120


def main(name: str, picture: Path) -> None:
    """Simulate a job and draw the arm at its highest position, or draw a video of three cubes if the file is a .gif."""
    arm = find_arm(name)
    is_film = picture.suffix == ".gif"
    stack = SimulatedStack(files=read_arm_files(arm), build=Build(backlash_deg=1.0)).up()
    stack.run(SETTLED_S)
    recorder = FilmRecorder(stack.world, PERIOD_S, FRAMES) if is_film else FilmRecorder(stack.world)
    stack.on_step = recorder.update
    pick_place = load_pick_place(arm.pick_place)
    for number, grade in enumerate(pick_place.grades if is_film else (GRADE.get(name, "A"),), 1):
        job = run_job(stack, pick_place.settings(), grade, number)
        assert job.success, job.message
    (recorder.save_film if is_film else recorder.save_still)(picture)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
