"""Detectors that users provide, with a tiny ONNX model that the test creates."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper

from perception.detector.classes import DetectorClasses, read_classes
from perception.detector.decode import decoded, fitted
from perception.detector.onnx_grader import OnnxGrader
from perception.grading.grader import Grader
from perception.perception_errors import DetectorError, GradesFileError
from tests.perception import painted

CLASSES = DetectorClasses(("A", "C", ""), 0.5, 0.5)
SIZE = 320


def model(path: Path, boxes: list[list[float]], shape: tuple[object, ...] = (1, 3, SIZE, SIZE)) -> Path:
    """Write a model whose boxes are fixed, and whose scores are 0 in a black picture.

    Args:
        path: The file.
        boxes: Center x, y, width, height and three scores of each box.
        shape: Shape of the input.
    """
    layout = np.array(boxes, np.float32).T[np.newaxis]
    nodes = [
        helper.make_node("ReduceMax", ["images"], ["bright"], keepdims=0),
        helper.make_node("Ceil", ["bright"], ["one"]),
        helper.make_node("Mul", ["boxes", "one"], ["output0"]),
    ]
    graph = helper.make_graph(
        nodes, "tiny",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("output0", TensorProto.FLOAT, layout.shape)],
        [helper.make_tensor("boxes", TensorProto.FLOAT, layout.shape, layout.ravel())],
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)
    return path


@pytest.fixture(scope="module")
def scene() -> tuple[Grader, np.ndarray, list[float]]:
    """A grader, a picture of one apple, and the box of the apple in the input of the model."""
    apple = painted.PaintedApple(np.array([0.25, 0.05, 0.03]), 0.03, painted.GREEN, 1.0, np.array([0.0, 0.0, 1.0]))
    picture, _ = painted.paint(painted.view(), [apple], painted.Lamp(lamp=0.7), 0)
    grader = Grader(painted.view())
    left, top, width, height = grader.grade(picture)[0].box_px
    # The 640 × 480 pixels fill 320 × 240 pixels of the input, below a margin of 40.
    return grader, picture, [(left + width / 2) / 2, (top + height / 2) / 2 + 40, width / 2, height / 2]


def test_a_detector_finds_and_grades_and_the_apple_is_measured(tmp_path: Path, scene) -> None:
    grader, picture, box = scene
    worse, elsewhere = [box[0] + 3, *box[1:], 0.6, 0.1, 0.0], [40, 60, 30, 30, 0.1, 0.3, 0.2]
    path = model(tmp_path / "m.onnx", [worse, [*box, 0.2, 0.9, 0.1], elsewhere])
    [apple] = OnnxGrader(path, CLASSES, grader).grade(picture)
    assert apple.grade == "C" and apple.diameter_mm == pytest.approx(60.0, abs=2.0)
    assert apple.position_m == pytest.approx([0.25, 0.05, 0.03], abs=0.003)
    assert apple.red_ratio > 0.95


def test_a_class_without_a_grade_gives_none(tmp_path: Path, scene) -> None:
    grader, picture, box = scene
    path = model(tmp_path / "m.onnx", [[*box, 0.0, 0.1, 0.9]], ("n", 3, "h", "w"))
    half = [value / 2 for value in box]  # any size is accepted, and 640 is used
    path = model(tmp_path / "m.onnx", [[*(4 * np.array(half)), 0.0, 0.1, 0.9]], (1, 3, "h", "w"))
    [apple] = OnnxGrader(path, CLASSES, grader).grade(picture)
    assert apple.grade == "" and apple.reason


def test_a_corrupt_file_is_one_sentence(tmp_path: Path, scene) -> None:
    (tmp_path / "m.onnx").write_bytes(b"not a model")
    with pytest.raises(DetectorError, match=r"m.onnx is not a runnable ONNX model: ") as error:
        OnnxGrader(tmp_path / "m.onnx", CLASSES, scene[0])
    assert "\n" not in str(error.value)
    with pytest.raises(DetectorError, match=r"model .*n.onnx does not exist"):
        OnnxGrader(tmp_path / "n.onnx", CLASSES, scene[0])


@pytest.mark.parametrize(
    ("rows", "shape", "message"),
    [
        ([[1.0] * 6], (1, 3, SIZE, SIZE), r"output has the shape \[1, 6, 1\] instead of \[1, 7, boxes\] for 3 classes"),
        ([[1.0] * 7], (1, 1, SIZE, SIZE), r"input is tensor\(float\) \[1, 1, 320, 320\] instead of"),
    ],
)
def test_a_model_of_another_layout_is_refused(tmp_path: Path, scene, rows, shape, message: str) -> None:
    with pytest.raises(DetectorError, match=message):
        OnnxGrader(model(tmp_path / "m.onnx", rows, shape), CLASSES, scene[0])


@given(st.lists(st.lists(st.floats(1.0, 300.0, width=32), min_size=7, max_size=7), min_size=1, max_size=20))
def test_the_kept_boxes_do_not_overlap(rows: list[list[float]]) -> None:
    output = np.array(rows, np.float32).T
    output[4:] /= 300.0
    kept = decoded(output, 0.3, 0.4)
    assert [one.score for one in kept] == sorted((one.score for one in kept), reverse=True)
    for index, one in enumerate(kept):
        for other in kept[:index]:
            low = np.maximum(one.box_px[:2], other.box_px[:2])
            shared = np.prod(np.maximum(np.minimum(one.box_px[2:], other.box_px[2:]) - low, 0.0))
            areas = [np.prod(box.box_px[2:] - box.box_px[:2]) for box in (one, other)]
            assert shared / (sum(areas) - shared) <= 0.4 + 1e-9


def test_values_that_are_no_numbers_are_no_objects() -> None:
    output = np.full((7, 3), np.nan, np.float32)
    output[:, 0] = [10, 10, -5, 5, 0.9, 0, 0]
    assert decoded(output, 0.5, 0.5) == []


def test_a_picture_keeps_its_shape_in_the_input() -> None:
    values, scale, margin = fitted(np.full((100, 400, 3), 255, np.uint8), (320, 320))
    assert values.shape == (1, 3, 320, 320) and scale == 0.8 and margin.tolist() == [0, 120]
    assert values[0, 0, 160, 10] == 1.0 and values[0, 0, 10, 10] == pytest.approx(114 / 255)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("classes: [good, bad]\ngrades: {ugly: C}\n", "unknown class ugly: choose from good, bad"),
        ("classes: [good, good]\ngrades: {good: A}\n", "two classes have the same name"),
        ("classes: []\ngrades: {}\n", "classes.yaml:1: classes: "),
        (
            "classes: [good]\ngrades: {good: A}\nleast_score: 2\n",
            "classes.yaml:3: least_score: must be at most 1, not 2",
        ),
    ],
)
def test_each_mistake_of_the_classes_has_its_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "classes.yaml").write_text(text)
    with pytest.raises(GradesFileError, match=message):
        read_classes(tmp_path / "classes.yaml")


def test_classes_are_mapped_in_their_order(tmp_path: Path) -> None:
    (tmp_path / "classes.yaml").write_text("classes: [leaf, good, bad]\ngrades: {good: a, bad: C}\n")
    assert read_classes(tmp_path / "classes.yaml").grades == ("", "A", "C")
