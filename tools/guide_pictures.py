"""Draw the images of docs/getting-started-so101.md: the virtual SO-101 at each step, with its real shapes.

Example: `python tools/guide_pictures.py joints docs/so101/joints.png`
"""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from PIL import Image

from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion
from hal.robot_description.link_meshes import link_meshes
from hal.types import FloatArray
from servoloop.arm_pictures.labels import COLORS, INK, Drawing, Label
from servoloop.arm_pictures.posed_arm import PosedArm, solid
from servoloop.arm_pictures.show import FILLED, SIZE, draw_arm
from servoloop.dashboard.shapes import scene_shapes, thing_shapes
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from servoloop.stack.pick_place import load_pick_place
from sim_backend.scene.still import take

ARM = find_arm("so101")
FILES = read_arm_servos(ARM)
PLANS = ARM.file.calibration
HALF = (SIZE[0] // 2, SIZE[1])
ADAPTER = "waveshare"
SERVO = "sts3215"
OPEN_RAD = 0.6
ABOVE = np.array([0.8, -0.55, 0.75])
FRONT = np.array([1.0, -0.12, 0.12])
SIDE = np.array([0.1, -1.0, 0.25])
CABLES = np.array([-0.35, -1.0, 0.45])
HALF_FILLED = (0.72, 0.75)
UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
CUBE_M: Vector = (0.225, 0.0, 0.045)
"""Position of the cube on its stand at the start, in m."""
TIPS: Mapping[str, tuple[str, Vector]] = {
    "moving jaw": ("moving_jaw_so101_v1_link", (-0.003, -0.065, 0.019)),
    "fixed jaw": ("gripper_link", (-0.018, 0.0, -0.085)),
}
"""Points on links, keyed by their labels."""
NO_POINTS: Mapping[str, tuple[str, Vector]] = {}


def joints() -> Image.Image:
    """Draw the names of the joints and their positive directions."""
    return draw_arm(ARM)


def chain() -> Image.Image:
    """Draw the cables from the adapter through all servos."""
    posed = PosedArm(FILES, {})
    still = take(posed.solids(), CABLES, SIZE, FILLED)
    places: dict[str, list[FloatArray]] = {ADAPTER: [], SERVO: []}
    for mesh in link_meshes(ARM.scene.parent):
        for kind, found in places.items():
            if mesh.path.name.startswith(kind):
                found.append(np.array(posed.pose(mesh.link, (mesh.position_m, mesh.quaternion))[0]))
    pixels = still.pixels(np.array(places[ADAPTER] + places[SERVO]))
    drawing = Drawing(still.picture)
    drawing.line(pixels, INK, 6.0)
    labels = [Label("adapter", "USB to the computer, and the supply of the servos", pixels[0], INK)]
    for number, (joint, place) in enumerate(zip(FILES.robot.joints, pixels[1:], strict=True)):
        before = "the adapter" if number == 0 else f"servo {number}"
        after = f" and to servo {number + 2}" if number + 1 < len(FILES.robot.joints) else " alone: the chain ends here"
        labels.append(Label(f"servo {number + 1}: {joint.name}", f"to {before}{after}", place, COLORS[number]))
    drawing.labels(labels)
    return drawing.image()


def marked() -> Image.Image:
    """Draw the marked pose of the calibration from the front and from the side."""
    ((name, plan),) = ((name, plan) for name, plan in PLANS.joints.items() if plan.zero == "pose")
    assert plan.at is not None
    position = {name: plan.at, "gripper": OPEN_RAD}
    return beside(
        half(position, FRONT, "from the front: one jaw straight above the other", TIPS),
        half(position, SIDE, "from the side: the wrist stretched forward", TIPS),
    )


def folded() -> Image.Image:
    """Draw the limp arm at rest, and the arm raised for the calibration."""
    return beside(
        half(PLANS.auto.start, SIDE, "folded, as it lies without torque"),
        half(PLANS.auto.clear, SIDE, "raised off the table for the calibration"),
    )


def half(
    position: Mapping[str, float], toward: FloatArray, text: str, points: Mapping[str, tuple[str, Vector]] = NO_POINTS
) -> Image.Image:
    """Draw the arm in half of an image, with a caption and labels of points on its links."""
    posed = PosedArm(FILES, position)
    still = take(posed.solids(), toward, HALF, HALF_FILLED)
    drawing = Drawing(still.picture)
    labels = []
    for number, (title, (link, point)) in enumerate(points.items()):
        place, _ = posed.pose(link, (point, UPRIGHT))
        labels.append(Label(title, "", still.pixels(np.array([place]))[0], COLORS[number]))
    if labels:
        drawing.labels(labels)
    drawing.caption(text)
    return drawing.image()


def cell() -> Image.Image:
    """Draw the positions of the cube, the stand and the bins."""
    pick_place = load_pick_place(ARM.pick_place)
    posed = PosedArm(FILES, dict(zip(pick_place.joints, pick_place.poses.ready, strict=True)) | {"gripper": OPEN_RAD})
    things = [*scene_shapes(ARM.scene), *thing_shapes(ARM.scene)]
    cube = next(shape for shape in things if shape.link == "cube")
    cube_pose = CUBE_M, UPRIGHT
    placed = [(shape, cube_pose if shape is cube else (shape.position_m, shape.quaternion)) for shape in things]
    still = take([*posed.solids(), *(solid(shape, pose) for shape, pose in placed)], ABOVE, SIZE, (0.66, 0.86))
    drawing = Drawing(still.picture)
    labels = []
    for number, name in enumerate(("bin_A", "bin_B", "bin_C", "stand", "cube")):
        middle = np.mean([pose[0] for shape, pose in placed if shape.link == name], axis=0)
        axis = np.array(FILES.description.joints["shoulder_pan"].xyz_m[:2])
        ahead, left = middle[:2] - axis
        text = f"{abs(ahead) * 100:.0f} cm ahead of the first axis"
        if abs(left) > 0.01:
            text += f", {abs(left) * 100:.0f} cm to the {'left' if left > 0 else 'right'}"
        label = Label(name.replace("_", " "), text, still.pixels(middle[None])[0], COLORS[number])
        labels.append(label)
    drawing.labels(labels)
    drawing.caption("left and right as seen from behind the arm")
    return drawing.image()


def beside(left: Image.Image, right: Image.Image) -> Image.Image:
    """Join two images of the same height."""
    both = Image.new("RGB", (left.width + right.width, left.height))
    both.paste(left, (0, 0))
    both.paste(right, (left.width, 0))
    return both


PICTURES: dict[str, Callable[[], Image.Image]] = {
    "chain": chain,
    "joints": joints,
    "folded": folded,
    "marked": marked,
    "cell": cell,
}


def main(name: str, picture: Path) -> None:
    """Draw one of the images."""
    PICTURES[name]().save(picture, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
