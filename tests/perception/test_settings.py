"""The file of thresholds."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.grading.settings import DEFAULT_RULES, GradingSettings, read_settings
from perception.perception_errors import GradesFileError

FILE = """\
grades:
  - {grade: A, red_ratio: [0.5, 1.0], defect_score: [0.0, 0.03], diameter_mm: [60, 1000]}
  - {grade: B, red_ratio: [0.0, 0.5], defect_score: [0.0, 0.03]}
  - {grade: C, defect_score: [0.03, 1.0]}
region_m: [0.1, -0.1, 0.3, 0.1]
"""


def written(folder: Path, text: str) -> Path:
    (folder / "grades.yaml").write_text(text)
    return folder / "grades.yaml"


@pytest.mark.parametrize(
    ("values", "grade"),
    [
        ((70.0, 1.0, 0.0), "A"),
        ((60.0, 0.5, 0.0), "A"),
        ((59.9, 0.5, 0.0), ""),
        ((70.0, 0.49, 0.0), "B"),
        ((70.0, 1.0, 0.03), "C"),
        ((70.0, 1.0, 1.0), "C"),
    ],
)
def test_a_range_includes_its_lower_end(tmp_path: Path, values: tuple[float, float, float], grade: str) -> None:
    assert read_settings(written(tmp_path, FILE)).grade_of(*values) == grade


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0.0, 0.5]", "[0.0, 0.6]", r"grades.yaml:3: grades A \(line 2\) and B overlap: change a range"),
        ("[0.03, 1.0]", "[1.0, 0.03]", "grades.yaml:4: grades.2: defect_score: .* write the smaller value first"),
        ("[0.03, 1.0]", "[0.03, .nan]", "grades.yaml:4: .* must be a finite number"),
        ("grade: B, ", "", "grades.yaml:3: grades.1.grade: is missing"),
        ("red_ratio: [0.0", "redness: [0.0", "grades.yaml:3: grades.1.redness: is not a known key"),
        ("[0.1, -0.1, 0.3, 0.1]", "[0.3, -0.1, 0.1, 0.1]", "write the smallest x and y, then the largest"),
    ],
)
def test_each_mistake_has_its_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in FILE
    with pytest.raises(GradesFileError, match=message):
        read_settings(written(tmp_path, FILE.replace(old, new, 1)))


@given(st.floats(15.0, 130.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_exactly_one_default_rule_covers_each_apple(diameter_mm: float, red_ratio: float, defect_score: float) -> None:
    values = {"diameter_mm": diameter_mm, "red_ratio": red_ratio, "defect_score": defect_score}
    assert len({rule.grade for rule in DEFAULT_RULES if rule.covers(values)}) == 1
    assert GradingSettings().grade_of(**values)
