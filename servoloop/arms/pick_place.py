"""An arm's pick-place parameters: what the node is started with, read without ROS."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Self

from pydantic import BaseModel, Field, ValidationError, model_validator

from controller.manager.node_parameters import names, parameters_of
from controller.manager.parameter_file import ALL, PARAMETERS, read_parameter_file
from hal.errors import ArmFileError
from hal.plausible import Position
from hal.yaml_file import mistakes

if TYPE_CHECKING:
    from nodes.pick_place.settings import Settings

NODE: Final = "vision_pick_place_controller"
Pose = Annotated[tuple[Position, ...], Field(min_length=1)]


class PickPlacePoses(BaseModel):
    """The two poses of every job, rad."""

    ready: Pose
    pick: Pose


class PickPlace(BaseModel):
    """The parameters that belong to the arm and its cell; the others are the node's business."""

    joints: tuple[str, ...]
    """The arm's, without the hand: the order of all poses."""
    poses: PickPlacePoses
    grades: tuple[str, ...]
    bins: dict[str, Pose]
    """By grade."""
    hand_open_m: Position
    """rad for a hand whose joint is revolute."""
    hand_closed_m: Position

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        homeless = [grade for grade in self.grades if grade not in self.bins]
        short = [name for name, pose in self.all_poses().items() if len(pose) != len(self.joints)]
        if homeless or short:
            problems = [f"grade {grade} has no pose under bins" for grade in homeless]
            problems += [f"{name} has not one number for each of the {len(self.joints)} joints" for name in short]
            raise ValueError("; ".join(problems))
        self.settings()  # raises ValueError for all that the node's own code refuses
        return self

    def all_poses(self) -> dict[str, Pose]:
        """Every pose by its name in the file."""
        bins = {f"bins.{grade}": pose for grade, pose in self.bins.items()}
        return {"poses.ready": self.poses.ready, "poses.pick": self.poses.pick, **bins}

    def settings(self) -> "Settings":
        """The same for the node's own code, its times as they are by default."""
        from nodes.pick_place.settings import Settings

        return Settings(
            joints=self.joints,
            ready_rad=self.poses.ready,
            pick_rad=self.poses.pick,
            bins_rad={grade: self.bins[grade] for grade in self.grades},
            hand_open_m=self.hand_open_m,
            hand_closed_m=self.hand_closed_m,
        )


def load_pick_place(path: Path) -> PickPlace:
    """Read the file. Raises ArmFileError with every mistake, its file and line."""
    if not path.exists():
        raise ArmFileError(
            f"{path} is missing: demo, simulate and bench arm go to the poses of this file; write it as "
            "docs/arms/README.md describes, or use servoloop up, which needs no such file"
        )
    file, content = read_parameter_file(path, ArmFileError)
    if not names(content, NODE) and ALL not in content:
        raise ArmFileError(f"{path}:1: {NODE} is missing: put the parameters below '{NODE}: {PARAMETERS}:'")
    try:
        return PickPlace.model_validate(parameters_of(content, NODE))
    except ValidationError as error:
        raise ArmFileError("\n".join(mistakes(file, error, (NODE, PARAMETERS), NODE))) from error
