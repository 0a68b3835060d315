"""Draw the arm in 3D: the measured arm, a ghost at the commanded positions, the goal's path and surrounding objects."""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Final

import numpy as np
import viser

from hal.robot_description.kinematics import Quaternion
from hal.types import FloatArray
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.dashboard.shapes import DrawnShape, Rgb
from servoloop.recording.robot_state import ScenePose
from servoloop.recording.sampler import LinkPose

PLAIN, TEMPERATURE, LOAD = "as described", "temperature", "load"
CHOICES: Final = (PLAIN, TEMPERATURE, LOAD)
COLD_C: Final = 25.0
HOT_C: Final = 70.0
"""Temperature at which STS servos disable their torque by default, in °C."""
SCALE: Final = np.array([(62, 121, 214), (74, 176, 110), (240, 196, 60), (214, 48, 40)])
STEPS: Final = 24
"""Number of steps in the color scale. With few steps, measurement noise does not cause messages to the browsers."""


def color_of(share: float) -> Rgb | None:
    """Return a color from blue (0) through green and yellow to red (1), or None for NaN."""
    if math.isnan(share):
        return None
    at = round(min(1.0, max(0.0, share)) * STEPS) / STEPS * (len(SCALE) - 1)
    low = min(int(at), len(SCALE) - 2)
    red, green, blue = np.round(SCALE[low] + (at - low) * (SCALE[low + 1] - SCALE[low])).astype(int).tolist()
    return red, green, blue


def shares(choice: str, temperature_c: FloatArray, effort: FloatArray, limit: FloatArray) -> FloatArray:
    """Return the position of each joint on the color scale (n,), from 0 to 1.

    The temperature scale ranges from 25 to 70 °C, and the load scale ranges from 0 to the effort limit.
    """
    if choice == TEMPERATURE:
        return (temperature_c - COLD_C) / (HOT_C - COLD_C)
    if choice == LOAD:
        return np.abs(effort) / limit
    return np.full(len(effort), math.nan)


MEASURED, COMMANDED, PATH, CELL, THINGS = "/measured", "/commanded", "/path", "/cell", "/things"
GHOST: Final[Rgb] = (70, 130, 220)
GHOST_OPACITY: Final = 0.3
PATH_RGB: Final[Rgb] = (220, 40, 140)
AXES_M: Final = 0.05
REACH_M: Final = 0.75
"""Reach of the arm that the camera position below is chosen for, in meters."""
CAMERA_M: Final = np.array([0.75, -0.6, 0.55])
TARGET_M: Final = np.array([0.12, 0.0, 0.17])


def add_ground(server: viser.ViserServer) -> None:
    """Add the grid, and set the initial camera position for an arm of average size."""
    server.scene.add_grid("/ground", width=2.0, height=2.0, cell_size=0.05, section_size=0.25)
    place_camera(server, REACH_M)


def place_camera(server: viser.ViserServer, reach_m: float) -> None:
    """Set the initial camera position so that an arm with this reach fills the page. Pages that are already open keep
    their camera position."""
    server.initial_camera.position = CAMERA_M * (reach_m / REACH_M)
    server.initial_camera.look_at = TARGET_M * (reach_m / REACH_M)


class DrawnScene:
    """Drawing of one arm and the objects around it."""

    def __init__(
        self,
        server: viser.ViserServer,
        model: DrawnArm,
        visuals: Iterable[DrawnShape],
        around: Iterable[DrawnShape] = (),
        things: Iterable[DrawnShape] = (),
    ) -> None:
        """Draw an arm.

        Args:
            server: Server of the page.
            model: Links of the arm.
            visuals: Shapes of the links.
            around: Shapes of fixed objects.
            things: Shapes of loose objects, which are shown when their poses are known.
        """
        self._server, self._model = server, model
        visuals = list(visuals)
        self._solid = DrawnRobot(server, model, MEASURED, visuals)
        self._ghost = DrawnRobot(server, model, COMMANDED, visuals, GHOST)
        self._path: viser.LineSegmentsHandle | None = None
        for number, shape in enumerate(around):
            _add(server, f"{CELL}/{number}", shape)
        self._things: dict[str, viser.FrameHandle] = {}
        for number, shape in enumerate(things):
            root = f"{THINGS}/{shape.link}"
            self._things[shape.link] = server.scene.add_frame(root, show_axes=False, visible=False)
            _add(server, f"{root}/{number}", shape)

    def show(self, position: FloatArray, command: FloatArray) -> None:
        """Move the arm to the measured positions (n,) and its ghost to the commanded positions (n,), in rad or m.

        Joints of the ghost without a command are shown at their measured positions.
        """
        with self._server.atomic():
            self._solid.move(self._model.moving(position))
            self._ghost.move(self._model.moving(np.where(np.isnan(command), position, command)))

    def show_things(self, poses: Mapping[str, ScenePose]) -> None:
        """Move the loose objects to their poses, and hide objects whose pose is unknown."""
        for name, frame in self._things.items():
            frame.visible = name in poses
            if frame.visible:
                frame.position, frame.wxyz = poses[name].position_m, _wxyz(poses[name].quaternion)

    def color(self, shares: FloatArray, faulty: Collection[str] = ()) -> None:
        """Color the links of each joint.

        Args:
            shares: Position of each joint on the color scale (n,), or NaN for the color in the robot description.
            faulty: Joints whose servos have a fault; their links are drawn in red.
        """
        self._solid.color(shares, faulty)

    def show_path(self, points_m: FloatArray | None) -> None:
        """Draw a path (m, 3) in the frame of the root link, in meters; None removes the path."""
        if self._path is not None:
            self._path.remove()
            self._path = None
        if points_m is not None and len(points_m) > 1:
            pairs = np.stack([points_m[:-1], points_m[1:]], axis=1).astype(np.float32)
            self._path = self._server.scene.add_line_segments(PATH, pairs, PATH_RGB, thickness=0.003)

    def show_frames(self, shown: bool) -> None:
        """Show or hide the frames of the links."""
        self._solid.show_frames(shown)

    def show_ghost(self, shown: bool) -> None:
        """Show or hide the ghost at the commanded positions."""
        self._ghost.show(shown)

    def remove(self) -> None:
        """Remove the arm and the objects around it from the page."""
        self.show_path(None)
        for name in (MEASURED, COMMANDED, CELL, THINGS):
            self._server.scene.remove_by_name(name)


class DrawnRobot:
    """Drawing of the solid arm or of a ghost, with a frame for each link. A ghost has a single color and does not
    include fixed links."""

    def __init__(
        self,
        server: viser.ViserServer,
        model: DrawnArm,
        root: str,
        visuals: Iterable[DrawnShape],
        ghost: Rgb | None = None,
    ) -> None:
        self._model = model
        self._top = server.scene.add_frame(root, show_axes=False)
        self._frames = {
            link: server.scene.add_frame(
                root + model.branch(link), show_axes=False, axes_length=AXES_M, axes_radius=AXES_M / 20
            )
            for link in sorted(model.links, key=model.branch)
        }
        self._meshes = [
            (shape, _add(server, f"{root}{model.branch(shape.link)}/shape{number}", shape, ghost))
            for number, shape in enumerate(visuals)
            if ghost is None or model.joint_of(shape.link) is not None
        ]
        self._colors: list[Rgb | None] = [None] * len(self._meshes)
        self.move(model.fixed())

    def move(self, poses: Iterable[LinkPose]) -> None:
        for pose in poses:
            frame = self._frames[pose.child]
            frame.position, frame.wxyz = pose.position_m, _wxyz(pose.quaternion)

    def color(self, shares: FloatArray, faulty: Collection[str]) -> None:
        places = {joint: place for place, joint in enumerate(self._model.measured)}
        for number, (shape, mesh) in enumerate(self._meshes):
            joint = self._model.joint_of(shape.link)
            share = 1.0 if joint in faulty else math.nan if joint is None else float(shares[places[joint]])
            wanted = color_of(share)
            if wanted != self._colors[number]:  # each change sends a message to all browsers
                mesh.color = shape.rgb if wanted is None else wanted
                self._colors[number] = wanted

    def show_frames(self, shown: bool) -> None:
        for frame in self._frames.values():
            frame.show_axes = shown

    def show(self, shown: bool) -> None:
        self._top.visible = shown


def _add(server: viser.ViserServer, name: str, shape: DrawnShape, ghost: Rgb | None = None) -> viser.MeshHandle:
    return server.scene.add_mesh_simple(
        name,
        shape.vertices.astype(np.float32),
        shape.faces.astype(np.uint32),
        color=ghost or shape.rgb,
        opacity=GHOST_OPACITY if ghost else None,
        flat_shading=shape.flat,
        cast_shadow=not ghost,
        receive_shadow=not ghost,
        position=shape.position_m,
        wxyz=_wxyz(shape.quaternion),
    )


def _wxyz(quaternion: Quaternion) -> Quaternion:
    """Return a quaternion in viser's order, with w first."""
    x, y, z, w = quaternion
    return w, x, y, z
