"""Declare the ROS parameters of the camera node, and build its camera and its grading from them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from drivers.clock import Clock
from perception.camera_view import CameraView, read_pose
from perception.detector.classes import read_classes
from perception.detector.onnx_grader import OnnxGrader
from perception.frames import CameraSource
from perception.grading.grader import Grader
from perception.grading.settings import GradingSettings, read_settings
from perception.grading_loop import Grading
from perception.intrinsics import Intrinsics, read_intrinsics
from perception.perception_errors import PerceptionError
from perception.sources.choice import source_of

FRAMES: Final = {
    "camera_frame": ("camera_optical_frame", "frame of the images"),
    "base_frame": ("base_link", "frame of the poses"),
}
"""Parameters of each camera, with their defaults and descriptions."""
OWN: Final[dict[str, tuple[Any, str]]] = {
    "source": ("", "path in /dev/v4l/by-id, index, video file, or folder of images"),
    "rate_hz": (30.0, "rate to request from the camera, in Hz"),
    "camera_file": ("camera.yaml", "intrinsics, as camera_calibration or 'servoloop camera calibrate' writes them"),
    "pose_file": ("camera_pose.yaml", "pose above the plane, as 'servoloop camera plane' writes it"),
    "grades_file": ("", "thresholds of the grades; empty for the built-in thresholds"),
    "detector": ("color", "color finds apples by their color; onnx uses your own model"),
    "model_file": ("", "ONNX file of the detector, in the layout of YOLOv8"),
    "classes_file": ("", "classes of the detector, and their grades"),
}
"""Parameters of a camera that is connected to this machine."""
KINDS: Final[dict[type, str]] = {str: "a text", float: "a number"}
"""Descriptions of parameter types."""


@dataclass(frozen=True, slots=True)
class CameraSetup:
    """A camera and its grading."""

    source: CameraSource
    intrinsics: Intrinsics
    grading: Grading


Setup = Callable[[Node], CameraSetup]
"""Function that declares a camera's parameters and opens the camera. Raises PerceptionError if the camera cannot be
opened."""


def declare(node: Node, wanted: Mapping[str, tuple[Any, str]]) -> dict[str, Any]:
    """Declare read-only parameters, and return their values, which have the types of the defaults.

    On a command line, ``source:=0`` and ``rate_hz:=30`` are integers, so both parameters accept numbers and strings.

    Args:
        node: Node of the camera.
        wanted: Defaults and descriptions, keyed by parameter name.

    Raises:
        PerceptionError: A value cannot be converted. All parameters are declared nevertheless.
    """
    values = {}
    for name, (default, description) in wanted.items():
        descriptor = ParameterDescriptor(read_only=True, dynamic_typing=True, description=description)
        values[name] = node.declare_parameter(name, default, descriptor).value
    return {name: _converted(name, values[name], type(default)) for name, (default, _) in wanted.items()}


def _converted(name: str, value: Any, kind: type) -> Any:
    try:
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            return kind(value)
    except ValueError:
        pass
    raise PerceptionError(f"parameter '{name}' is {value!r}: set it to {KINDS[kind]}")


def given_camera(source: CameraSource, view: CameraView, settings: GradingSettings) -> Setup:
    """Return the setup for a camera that the program has created."""
    return lambda node: CameraSetup(source, view.intrinsics, Grader(view, settings).grade)


def camera_of_parameters(clock: Clock) -> Setup:
    """Return the setup for the camera that the parameters select."""

    def setup(node: Node) -> CameraSetup:
        values = declare(node, OWN)
        rate_hz = float(values["rate_hz"])
        if not 0.1 <= rate_hz <= 240.0:
            raise PerceptionError(f"parameter 'rate_hz' is {rate_hz:g}: choose a rate from 0.1 to 240 Hz")
        intrinsics = read_intrinsics(Path(values["camera_file"]))
        view = CameraView(intrinsics, read_pose(Path(values["pose_file"]), intrinsics.name))
        settings = read_settings(Path(values["grades_file"])) if values["grades_file"] else GradingSettings()
        source = source_of(values["source"], clock, intrinsics.size, rate_hz)
        return CameraSetup(source, intrinsics, _grading(values, Grader(view, settings)))

    return setup


def _grading(values: Mapping[str, Any], grader: Grader) -> Grading:
    """Return the function that grades images with the detector that the parameters select."""
    if values["detector"] == "color":
        return grader.grade
    if values["detector"] != "onnx":
        raise PerceptionError(f"parameter 'detector' is {values['detector']!r}: choose color or onnx")
    for name in ("model_file", "classes_file"):
        if not values[name]:
            raise PerceptionError(f"parameter '{name}' is empty: set it to your detector's file")
    return OnnxGrader(Path(values["model_file"]), read_classes(Path(values["classes_file"])), grader).grade
