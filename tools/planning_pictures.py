"""Draw the images of docs/planning.md: the virtual SO-101 with planned motions around a wall and to a pose.

Example: `python tools/planning_pictures.py wall docs/planning/wall.png`
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from hal.types import FloatArray
from planning.scene import Box, Pose, SceneObject
from servoloop import ArmPose, ArmTrajectory, MotionPlanner
from servoloop.arm_pictures.labels import COLORS, Drawing, Label
from servoloop.arm_pictures.posed_arm import PosedArm
from servoloop.arm_pictures.show import SIZE
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from sim_backend.scene.still import Solid, Still, take

ARM = "so101"
FILES = read_arm_servos(find_arm(ARM))
START = {"shoulder_pan": 0.9, "shoulder_lift": 0.3, "elbow_flex": 0.2, "wrist_flex": 0.4, "wrist_roll": 0.0}
GOAL = {**START, "shoulder_pan": -0.9}
WALL_M = ((0.30, 0.02, 0.24), (0.30, 0.0, 0.12))
"""Size and position of the wall, in meters."""
WALL_RGB = (0.75, 0.55, 0.35)
TOWARD = np.array([0.75, -0.75, 0.6])
FILLED = (0.62, 0.8)
LEVEL = (0.0, 0.0, 0.0, 1.0)


def wall() -> Image.Image:
    """Draw the path of the tool over a wall, and the straight motion through it."""
    planner = bench()
    still = take([*PosedArm(FILES, START).solids(), box(*WALL_M)], TOWARD, SIZE, FILLED)
    drawing = Drawing(still.picture)
    straight = [{**START, "shoulder_pan": float(at)} for at in np.linspace(0.9, -0.9, 60)]
    planned = states_of(planner.plan(START, GOAL))
    labels = []
    for number, (title, text, states) in enumerate(
        (("planned", "around the obstacles of arm.scene", planned), ("straight", "as arm.move_to goes", straight))
    ):
        path = pixels(still, planner, states)
        drawing.line(path, COLORS[number])
        labels.append(Label(title, text, path[len(path) // 2], COLORS[number]))
    drawing.labels(labels)
    return drawing.image()


def pose() -> Image.Image:
    """Draw the poses at the start and the end of a motion to a position."""
    planner = bench()
    trajectory = planner.plan(GOAL, ArmPose((0.25, -0.12, 0.10)))
    end = states_of(trajectory)[-1]
    still = take([*PosedArm(FILES, end).solids(), box(*WALL_M)], TOWARD, SIZE, FILLED)
    drawing = Drawing(still.picture)
    path = pixels(still, planner, states_of(trajectory))
    drawing.line(path, COLORS[0])
    drawing.labels(
        [
            Label("start", "where the arm was measured", path[0], COLORS[2]),
            Label("goal", "the origin of gripper_link, in any orientation", path[-1], COLORS[1]),
        ]
    )
    return drawing.image()


def bench() -> MotionPlanner:
    """Return a planner for the arm with a wall, but without the objects of its scene file."""
    planner, (size_m, position_m) = MotionPlanner(ARM), WALL_M
    for name in ("cube", "stand", "bin_A", "bin_B", "bin_C"):
        planner.scene = planner.scene.without(name)
    item = SceneObject("wall", ((Box(*size_m), Pose()),), Pose(np.array(position_m)))
    planner.scene = planner.scene.with_object(item)
    return planner


def states_of(trajectory: ArmTrajectory) -> list[dict[str, float]]:
    """Return the positions at each point of a trajectory, keyed by joint name."""
    rows = zip(*trajectory.positions.values(), strict=True)
    return [dict(zip(trajectory.positions, row, strict=True)) for row in rows]


def pixels(still: Still, planner: MotionPlanner, states: list[dict[str, float]]) -> FloatArray:
    """Return the path of the tool in pixels of the image (k, 2)."""
    return still.pixels(np.array([planner.pose(state)[0] for state in states]))


def box(size_m: tuple[float, float, float], position_m: tuple[float, float, float]) -> Solid:
    """Return a box in the world."""
    mesh = trimesh.creation.box(size_m)
    return Solid(np.array(mesh.vertices), np.array(mesh.faces), (position_m, LEVEL), WALL_RGB)


PICTURES: dict[str, Callable[[], Image.Image]] = {"wall": wall, "pose": pose}


def main(name: str, picture: Path) -> None:
    """Draw one of the images."""
    PICTURES[name]().save(picture, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
