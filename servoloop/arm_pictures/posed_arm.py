"""Compute the shapes of an arm in a pose, together with its joint positions and directions."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion, multiply, rotate
from hal.types import FloatArray
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.dashboard.shapes import DrawnShape, arm_shapes
from servoloop.stack.robot_files import ServoFiles
from sim_backend.scene.still import Solid

Pose = tuple[Vector, Quaternion]
"""Position in meters and orientation as a unit quaternion (x, y, z, w)."""
TURN_RAD: Final = np.radians(250.0)
"""Angle covered by an arrow around an axis, in rad."""
STEPS: Final = 48
ARROW: Final = 0.085
"""Radius of an arrow around an axis, and half the length of an arrow along an axis, as a fraction of the arm's
reach."""


@dataclass(frozen=True, slots=True)
class JointArrow:
    """Position (3,) of a joint in the world, in meters, and an arrow (k, 3) in its positive direction."""

    name: str
    place: FloatArray
    arrow: FloatArray


class PosedArm:
    """Arm with its joints at ``position``, which is in rad or m and keyed by joint name. The other joints are at
    zero."""

    def __init__(self, files: ServoFiles, position: Mapping[str, float]) -> None:
        self._files = files
        self._joints = files.description.joints
        self._driven = [joint.name for joint in files.robot.joints]
        self._model = DrawnArm(self._joints, self._driven)
        self._position = np.array([position.get(name, 0.0) for name in self._driven])

    def solids(self) -> Iterator[Solid]:
        """Yield the shapes of the links, using meshes if the arm has them."""
        files = self._files
        drawn, _ = arm_shapes(files.description.xml, files.urdf_path.parent, files.scene.parent)
        for shape in drawn:
            yield solid(shape, self.pose(shape.link, (shape.position_m, shape.quaternion)))

    def pose(self, link: str, pose: Pose) -> Pose:
        """Transform a pose from a link's frame to the world."""
        (x, y, z), turn = self._model.pose(link, self._position)
        a, b, c = rotate(turn, pose[0])
        return (x + a, y + b, z + c), multiply(turn, pose[1])

    def arrows(self) -> list[JointArrow]:
        """Return the arrows for all joints that have a servo, in the order of the robot file."""
        return [self._arrow(name) for name in self._driven]

    def _arrow(self, name: str) -> JointArrow:
        joint = self._joints[name]
        place, turn = self._model.pose(joint.child, self._position)
        axis = np.array(rotate(turn, joint.axis)) / np.linalg.norm(joint.axis)
        size = ARROW * self._model.reach_m
        if joint.kind == "prismatic":
            return JointArrow(name, np.array(place), place + np.linspace(-size, size, STEPS)[:, None] * axis)
        first, second = _across(axis)
        angle = np.linspace(0.0, TURN_RAD, STEPS)[:, None]
        return JointArrow(name, np.array(place), place + size * (np.cos(angle) * first + np.sin(angle) * second))


def solid(shape: DrawnShape, pose: Pose) -> Solid:
    """Place a shape at a pose in the world."""
    red, green, blue = (part / 255.0 for part in shape.rgb)
    return Solid(shape.vertices, shape.faces, pose, (red, green, blue))


def _across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors (3,) that form a right-handed frame with an axis.

    The first vector points down if possible.
    """
    down: Vector = (0.0, 0.0, -1.0) if abs(axis[2]) < 0.9 else (-1.0, 0.0, 0.0)
    first = np.array(down) - np.dot(down, axis) * axis
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)
