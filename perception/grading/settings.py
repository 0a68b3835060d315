"""Read the grading settings: grade thresholds, and limits that define what is considered an apple."""

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveFloat, model_validator

from hal.yaml_file import load_with_lines
from perception.perception_errors import GradesFileError

QUANTITIES: Final = ("diameter_mm", "red_ratio", "defect_score")
"""Names of the measured quantities that have thresholds."""
TOPS: Final = {"diameter_mm": 1000.0, "red_ratio": 1.0, "defect_score": 1.0}
"""Maximum value of each quantity. A range that ends at this value includes the value."""

Range = tuple[float, float]
"""Range with its lower bound (inclusive) and its upper bound (exclusive)."""


@dataclass(frozen=True, slots=True)
class GradeRule:
    """Rule that assigns a grade to apples whose values are within its ranges. A grade may have several rules."""

    grade: str
    diameter_mm: Range = (0.0, 1000.0)
    red_ratio: Range = (0.0, 1.0)
    defect_score: Range = (0.0, 1.0)

    def covers(self, values: dict[str, float]) -> bool:
        """Return whether the rule covers an apple's values, keyed by quantity."""
        return all(_within(values[name], getattr(self, name), TOPS[name]) for name in QUANTITIES)

    def overlaps(self, other: "GradeRule") -> bool:
        """Return whether an apple can match both rules."""
        pairs = [(getattr(self, name), getattr(other, name)) for name in QUANTITIES]
        return all(max(one[0], two[0]) < min(one[1], two[1]) for one, two in pairs)


def _within(value: float, limits: Range, top: float) -> bool:
    return limits[0] <= value and (value < limits[1] or limits[1] >= top)


DEFAULT_RULES: Final = (
    GradeRule("A", red_ratio=(0.5, 1.0), defect_score=(0.0, 0.03)),
    GradeRule("B", red_ratio=(0.0, 0.5), defect_score=(0.0, 0.03)),
    GradeRule("B", defect_score=(0.03, 0.12)),
    GradeRule("C", defect_score=(0.12, 1.0)),
)
"""Default rules: red apples without defects are graded A, apples with large defects C, and all other apples B."""


@dataclass(frozen=True, slots=True)
class GradingSettings:
    """Grade thresholds, and limits that define what is considered an apple."""

    rules: tuple[GradeRule, ...] = DEFAULT_RULES
    diameter_mm: Range = (15.0, 130.0)
    """Range of apple diameters, in mm. Smaller and larger objects are ignored."""
    region_m: tuple[float, float, float, float] | None = None
    """Region in base_link in which to search for apples: smallest x and y, largest x and y, in m. None means no
    limit."""
    table_rgb: tuple[float, float, float] = (0.6, 0.6, 0.6)
    """Fractions of red, green and blue light that the table reflects. For a gray table, the three values are equal."""
    least_visible: float = 0.7
    """Minimum visible fraction of an apple required to grade it."""

    def grade_of(self, diameter_mm: float, red_ratio: float, defect_score: float) -> str:
        """Return an apple's grade, or an empty string if no rule covers the values."""
        values = {"diameter_mm": diameter_mm, "red_ratio": red_ratio, "defect_score": defect_score}
        return next((rule.grade for rule in self.rules if rule.covers(values)), "")


_Pair = Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]
_Share = Annotated[float, Field(ge=0.01, le=1.0)]


class _Rule(BaseModel):
    model_config = ConfigDict(extra="forbid")
    grade: Annotated[str, Field(min_length=1, max_length=20, pattern=r"^\S+$")]
    diameter_mm: _Pair = [0.0, 1000.0]
    red_ratio: _Pair = [0.0, 1.0]
    defect_score: _Pair = [0.0, 1.0]

    @model_validator(mode="after")
    def _ordered(self) -> "_Rule":
        for name in QUANTITIES:
            low, high = getattr(self, name)
            if not 0.0 <= low < high <= TOPS[name]:
                raise ValueError(
                    f"{name}: [{low}, {high}] is not a range within 0 to {TOPS[name]:g}: write the smaller value first"
                )
        return self

    def rule(self) -> GradeRule:
        ranges = {name: (getattr(self, name)[0], getattr(self, name)[1]) for name in QUANTITIES}
        return GradeRule(self.grade.upper(), **ranges)


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    grades: Annotated[list[_Rule], Field(min_length=1, max_length=100)]
    apple_diameter_mm: Annotated[list[PositiveFloat], Field(min_length=2, max_length=2)] = [15.0, 130.0]
    region_m: Annotated[list[FiniteFloat], Field(min_length=4, max_length=4)] | None = None
    table_rgb: Annotated[list[_Share], Field(min_length=3, max_length=3)] = [0.6, 0.6, 0.6]
    least_visible: Annotated[float, Field(ge=0.4, le=1.0)] = 0.7

    @model_validator(mode="after")
    def _ordered(self) -> "_File":
        if self.apple_diameter_mm[0] >= self.apple_diameter_mm[1]:
            raise ValueError(f"apple_diameter_mm {self.apple_diameter_mm}: write the smaller value first")
        if self.region_m is not None and not (
            self.region_m[0] < self.region_m[2] and self.region_m[1] < self.region_m[3]
        ):
            raise ValueError(f"region_m {self.region_m}: write the smallest x and y, then the largest x and y")
        return self


def read_settings(path: Path) -> GradingSettings:
    """Read the grading settings from a file.

    Raises:
        GradesFileError: The file has errors, or the rules of different grades overlap. The message states the line of
            each error.
    """
    file, places = load_with_lines(path, _File, GradesFileError)
    rules = tuple(entry.rule() for entry in file.grades)
    lines = tuple(places.line(("grades", index)) for index in range(len(rules)))
    mistakes = [
        f"{path}:{lines[second]}: grades {rules[first].grade} (line {lines[first]}) and {rules[second].grade} overlap: "
        "change a range, so that each apple has one grade"
        for first, second in combinations(range(len(rules)), 2)
        if rules[first].grade != rules[second].grade and rules[first].overlaps(rules[second])
    ]
    if mistakes:
        raise GradesFileError("\n".join(mistakes))
    low, high = file.apple_diameter_mm
    red, green, blue = file.table_rgb
    region = None
    if file.region_m is not None:
        x_min, y_min, x_max, y_max = file.region_m
        region = (x_min, y_min, x_max, y_max)
    return GradingSettings(rules, (low, high), region, (red, green, blue), file.least_visible)
