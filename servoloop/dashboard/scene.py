"""The arm in 3-D: measured solid, commanded as a ghost, the newest goal's path, what stands around it."""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Final

import numpy as np
import viser

from hal.robot_description.kinematics import Quaternion
from hal.types import FloatArray
from servoloop.dashboard.arm_model import ArmModel
from servoloop.dashboard.shapes import Rgb, Shape
from servoloop.recording.robot_state import ScenePose
from servoloop.recording.sampler import LinkPose

PLAIN, TEMPERATURE, LOAD = "as described", "temperature", "load"
CHOICES: Final = (PLAIN, TEMPERATURE, LOAD)
COLD_C: Final = 25.0
HOT_C: Final = 70.0
"""At which servos of the STS series switch themselves off, as they come."""
SCALE: Final = np.array([(62, 121, 214), (74, 176, 110), (240, 196, 60), (214, 48, 40)])
STEPS: Final = 24
"""So many colours at the most: a servo's noise is not worth a message to the browser."""


def colour(share: float) -> Rgb | None:
    """The colour from blue (0) by green and yellow to red (1); None for NaN."""
    if math.isnan(share):
        return None
    at = round(min(1.0, max(0.0, share)) * STEPS) / STEPS * (len(SCALE) - 1)
    low = min(int(at), len(SCALE) - 2)
    red, green, blue = np.round(SCALE[low] + (at - low) * (SCALE[low + 1] - SCALE[low])).astype(int).tolist()
    return red, green, blue


def shares(choice: str, temperature_c: FloatArray, effort: FloatArray, limit: FloatArray) -> FloatArray:
    """How far up the scale each joint (n,) is: temperature from 25 to 70 °C, load as a share of the effort limit."""
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
"""Of the arm that the camera's place below suits."""
CAMERA_M: Final = np.array([0.75, -0.6, 0.55])
TARGET_M: Final = np.array([0.12, 0.0, 0.17])


def add_ground(server: viser.ViserServer) -> None:
    """Put the grid in place, and the first camera for an arm that is not known yet."""
    server.scene.add_grid("/ground", width=2.0, height=2.0, cell_size=0.05, section_size=0.25)
    place_camera(server, REACH_M)


def place_camera(server: viser.ViserServer, reach_m: float) -> None:
    """Move the first camera so that an arm of this reach fills the page; cameras of open pages stay."""
    server.initial_camera.position = CAMERA_M * (reach_m / REACH_M)
    server.initial_camera.look_at = TARGET_M * (reach_m / REACH_M)


class ArmScene:
    """The arm of one robot description in the page."""

    def __init__(
        self,
        server: viser.ViserServer,
        model: ArmModel,
        visuals: Iterable[Shape],
        around: Iterable[Shape] = (),
        things: Iterable[Shape] = (),
    ) -> None:
        """``around`` stands where it is; ``things`` are drawn once somebody says where they are."""
        self._server, self._model = server, model
        visuals = list(visuals)
        self._solid = _Robot(server, model, MEASURED, visuals)
        self._ghost = _Robot(server, model, COMMANDED, visuals, ghost=True)
        self._path: viser.LineSegmentsHandle | None = None
        for number, shape in enumerate(around):
            _add(server, f"{CELL}/{number}", shape)
        self._things: dict[str, viser.FrameHandle] = {}
        for number, shape in enumerate(things):
            root = f"{THINGS}/{shape.link}"
            self._things[shape.link] = server.scene.add_frame(root, show_axes=False, visible=False)
            _add(server, f"{root}/{number}", shape)

    def show(self, position: FloatArray, command: FloatArray) -> None:
        """Move the arm and its ghost to joint positions (n,); what is not commanded stands where it is measured."""
        with self._server.atomic():
            self._solid.move(self._model.moving(position))
            self._ghost.move(self._model.moving(np.where(np.isnan(command), position, command)))

    def show_things(self, poses: Mapping[str, ScenePose]) -> None:
        """Move the things around the arm; one whose place is not known is not shown."""
        for name, frame in self._things.items():
            frame.visible = name in poses
            if frame.visible:
                frame.position, frame.wxyz = poses[name].position_m, _wxyz(poses[name].quaternion)

    def colour(self, shares: FloatArray, faulty: Collection[str] = ()) -> None:
        """Colour each joint's link by its share (n,) of the scale; NaN keeps the color of the robot description.

        ``faulty``: joints whose servos have a fault; their links are red.
        """
        self._solid.colour(shares, faulty)

    def show_path(self, points_m: FloatArray | None) -> None:
        """Draw a path (m, 3) in the root link, or none."""
        if self._path is not None:
            self._path.remove()
            self._path = None
        if points_m is not None and len(points_m) > 1:
            pairs = np.stack([points_m[:-1], points_m[1:]], axis=1).astype(np.float32)
            self._path = self._server.scene.add_line_segments(PATH, pairs, PATH_RGB, thickness=0.003)

    def show_frames(self, shown: bool) -> None:
        """Show or hide the links' frames."""
        self._solid.show_frames(shown)

    def show_ghost(self, shown: bool) -> None:
        """Show or hide what is commanded."""
        self._ghost.show(shown)

    def remove(self) -> None:
        """Take the arm and what stands around it out of the page."""
        self.show_path(None)
        for name in (MEASURED, COMMANDED, CELL, THINGS):
            self._server.scene.remove_by_name(name)


class _Robot:
    """One drawing of the arm: a frame for each link, its shapes below; the ghost is without links that never move."""

    def __init__(
        self, server: viser.ViserServer, model: ArmModel, root: str, visuals: Iterable[Shape], ghost: bool = False
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
            if not ghost or model.joint_of(shape.link) is not None
        ]
        self._colours: list[Rgb | None] = [None] * len(self._meshes)
        self.move(model.fixed())

    def move(self, poses: Iterable[LinkPose]) -> None:
        for pose in poses:
            frame = self._frames[pose.child]
            frame.position, frame.wxyz = pose.position_m, _wxyz(pose.quaternion)

    def colour(self, shares: FloatArray, faulty: Collection[str]) -> None:
        places = {joint: place for place, joint in enumerate(self._model.measured)}
        for number, (shape, mesh) in enumerate(self._meshes):
            joint = self._model.joint_of(shape.link)
            share = 1.0 if joint in faulty else math.nan if joint is None else float(shares[places[joint]])
            wanted = colour(share)
            if wanted != self._colours[number]:  # each one is a message
                mesh.color = shape.rgb if wanted is None else wanted
                self._colours[number] = wanted

    def show_frames(self, shown: bool) -> None:
        for frame in self._frames.values():
            frame.show_axes = shown

    def show(self, shown: bool) -> None:
        self._top.visible = shown


def _add(server: viser.ViserServer, name: str, shape: Shape, ghost: bool = False) -> viser.MeshHandle:
    return server.scene.add_mesh_simple(
        name,
        shape.vertices.astype(np.float32),
        shape.faces.astype(np.uint32),
        color=GHOST if ghost else shape.rgb,
        opacity=GHOST_OPACITY if ghost else None,
        flat_shading=shape.flat,
        cast_shadow=not ghost,
        receive_shadow=not ghost,
        position=shape.position_m,
        wxyz=_wxyz(shape.quaternion),
    )


def _wxyz(quaternion: Quaternion) -> Quaternion:
    """Viser has w first."""
    x, y, z, w = quaternion
    return w, x, y, z
