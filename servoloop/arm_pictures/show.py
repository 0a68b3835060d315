"""Draw an arm with the name, servo ID and direction of each joint."""

import io
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from commissioning.atomic_write import write_file
from servoloop.arm_pictures.labels import COLORS, Drawing, Label
from servoloop.arm_pictures.posed_arm import PosedArm
from servoloop.stack.arm_folders import ArmFolder, read_arm_servos
from sim_backend.scene.still import take

SIZE: Final = (1200, 760)
TOWARD: Final = np.array([0.55, -1.0, 0.5])
"""View direction, from above and from the right side of the arm. The arm points to the right of the image."""
FILLED: Final = (0.6, 0.8)
"""Maximum fractions of the image's width and height that the arm may fill. The remaining space is for labels."""


def draw_arm(arm: ArmFolder) -> Image.Image:
    """Draw an arm at the zero pose with the names and directions of its joints.

    Raises:
        ArmFileError, DescriptionError, RobotFileError: A file of the arm has errors.
    """
    files = read_arm_servos(arm)
    posed = PosedArm(files, {})
    still = take(posed.solids(), TOWARD, SIZE, FILLED)
    drawing = Drawing(still.picture)
    labels = []
    for number, arrow in enumerate(posed.arrows()):
        color = COLORS[number % len(COLORS)]
        drawing.arrow(still.pixels(arrow.arrow), color)
        plan = arm.file.calibration.joints.get(arrow.name)
        title = f"{arrow.name} (servo {files.robot.file.joints[arrow.name].servo_id})"
        labels.append(Label(title, plan.positive if plan else "", still.pixels(arrow.place[None])[0], color))
    drawing.labels(labels)
    return drawing.image()


def write_picture(image: Image.Image, path: Path) -> None:
    """Write an image as PNG. An existing file is renamed to NAME.1. Raises DriverError."""
    content = io.BytesIO()
    image.save(content, "PNG", optimize=True)
    write_file(path, content.getvalue())
