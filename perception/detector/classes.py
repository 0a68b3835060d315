"""Read the file that maps a detector's classes to grades."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from hal.yaml_file import load
from perception.perception_errors import GradesFileError

Name = Annotated[str, Field(min_length=1, max_length=100)]


@dataclass(frozen=True, slots=True)
class DetectorClasses:
    """Grades for a detector's classes, and its thresholds."""

    grades: tuple[str, ...]
    """Grade of each class, in class order. If the grade is empty, apples of this class are not assigned a grade."""
    least_score: float
    most_overlap: float


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    classes: Annotated[list[Name], Field(min_length=1, max_length=1000)]
    grades: dict[Name, Name]
    least_score: Annotated[float, Field(ge=0.01, le=1.0)] = 0.5
    most_overlap: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5

    @model_validator(mode="after")
    def _known(self) -> "_File":
        unknown = [name for name in self.grades if name not in self.classes]
        if unknown:
            raise ValueError(f"grades: unknown class {', '.join(unknown)}: choose from {', '.join(self.classes)}")
        if len(set(self.classes)) < len(self.classes):
            raise ValueError("classes: two classes have the same name: give each class its own name")
        return self


def read_classes(path: Path) -> DetectorClasses:
    """Read a detector's classes and their grades. Raises GradesFileError with the line of every error."""
    file = load(path, _File, GradesFileError)
    grades = tuple(file.grades.get(name, "").strip().upper() for name in file.classes)
    return DetectorClasses(grades, file.least_score, file.most_overlap)
