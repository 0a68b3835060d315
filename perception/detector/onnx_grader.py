"""Grade apples with the user's ONNX model."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from perception.detector.classes import DetectorClasses
from perception.detector.decode import decoded, fitted
from perception.frames import Picture
from perception.grading.grader import FoundBox, GradedApple, Grader
from perception.perception_errors import DetectorError

USUAL_SIZE: Final = 640
"""Input width and height for a model that accepts any size, in pixels."""
LARGEST_SIZE: Final = 4096


class OnnxGrader:
    """Grader that finds and grades apples with a model. Size, position and skin are measured in the same way as without
    a model."""

    def __init__(self, path: Path, classes: DetectorClasses, grader: Grader) -> None:
        """Load a model.

        Args:
            path: ONNX file in the YOLOv8 layout: input (1, 3, height, width), output (1, 4 + classes, boxes). classes:
            Grades for the model's classes.
            grader: Grader that measures the apples.

        Raises:
            DetectorError: The file cannot be used.
        """
        self._path, self._classes, self._grader = path, classes, grader
        self._session = _session(path)
        self._input, self._size = self._input_of()
        picture = np.full((48, 64, 3), 128, np.uint8)
        self._run(picture)  # a model with the wrong output is rejected before the first frame

    def grade(self, picture: Picture) -> list[GradedApple]:
        """Grade the apples of an RGB image (height, width, 3), as ``Grader.grade`` does.

        Raises:
            DetectorError: The model fails to run.
            PictureRefused: The image has the wrong resolution, or is black or overexposed.
        """
        output, scale, margin = self._run(picture)
        found = decoded(output, self._classes.least_score, self._classes.most_overlap)
        shift = np.tile(margin, 2)
        boxes = [FoundBox((one.box_px - shift) / scale, self._classes.grades[one.label]) for one in found]
        return self._grader.grade_boxes(picture, boxes)

    def _input_of(self) -> tuple[str, tuple[int, int]]:
        entry = self._session.get_inputs()[0]
        shape = list(entry.shape)
        if len(shape) != 4 or shape[1] != 3 or entry.type != "tensor(float)":
            raise DetectorError(
                f"{self._path}: the input is {entry.type} {shape} instead of tensor(float) [1, 3, height, width]: "
                "export the model in the layout of YOLOv8"
            )
        height, width = (size if isinstance(size, int) and size > 0 else USUAL_SIZE for size in shape[2:])
        if max(height, width) > LARGEST_SIZE:
            raise DetectorError(f"{self._path}: the input has {width} × {height} pixels: export a smaller model")
        return str(entry.name), (width, height)

    def _run(self, picture: Picture) -> tuple[Any, float, Any]:
        values, scale, margin = fitted(picture, self._size)
        try:
            outputs = self._session.run(None, {self._input: values})
        except Exception as error:  # onnxruntime has an error class for each status
            raise DetectorError(f"{self._path} failed to run: {_line(error)}: export the model again") from error
        output = np.asarray(outputs[0])
        wanted = 4 + len(self._classes.grades)
        if output.ndim != 3 or output.shape[0] != 1 or output.shape[1] != wanted:
            raise DetectorError(
                f"{self._path}: the output has the shape {list(output.shape)} instead of [1, {wanted}, boxes] for "
                f"{wanted - 4} classes: correct the class file, or export the model in the layout of YOLOv8"
            )
        return output[0].astype(np.float32), scale, margin


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ModuleNotFoundError as error:
        raise DetectorError("a detector requires onnxruntime: install servoloop with the onnx extra") from error
    if not path.is_file():
        raise DetectorError(f"model {path} does not exist: specify an ONNX file")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # the other processors are left to the control loop
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has an error class for each status
        raise DetectorError(f"{path} is not a runnable ONNX model: {_line(error)}: export the model again") from error


def _line(error: Exception) -> str:
    """Return the first line of an error message, without onnxruntime's error codes."""
    text = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    return text.rpartition(" : ")[2].rstrip(".: ")[:200]
