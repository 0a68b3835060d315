"""Read the file that maps the classes of a detector to grades."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from hal.yaml_file import load
from perception.errors import GradesFileError

Name = Annotated[str, Field(min_length=1, max_length=100)]


@dataclass(frozen=True, slots=True)
class DetectorClasses:
    """Grades of the classes of a detector, and its thresholds."""

    grades: tuple[str, ...]
    """Grade of each class, in the order of the classes. If the grade is empty, apples of this class get no grade."""
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
            raise ValueError(f"grades: there is no class {', '.join(unknown)}: choose from {', '.join(self.classes)}")
        if len(set(self.classes)) < len(self.classes):
            raise ValueError("classes: a name occurs twice: give each class its own name")
        return self


def read_classes(path: Path) -> DetectorClasses:
    """Read the classes of a detector and their grades. Raise GradesFileError with the line of every error."""
    file = load(path, _File, GradesFileError)
    grades = tuple(file.grades.get(name, "").strip().upper() for name in file.classes)
    return DetectorClasses(grades, file.least_score, file.most_overlap)
