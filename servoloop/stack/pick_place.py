"""Read and check the parameters of the pick-place node; ROS is not required."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Self

from pydantic import BaseModel, Field, ValidationError, model_validator

from controller.manager.parameter_file import PARAMETERS
from controller.manager.sections import Sections
from hal.hal_errors import ArmFileError
from hal.plausible import Position
from hal.yaml_file import mistakes

if TYPE_CHECKING:
    from pick_place.settings import JobSettings


NODE: Final = "vision_pick_place_controller"
ARM: Final = "arm_controller"
HAND: Final = "hand_controller"
"""Names of the controllers that the node uses by default."""
Pose = Annotated[tuple[Position, ...], Field(min_length=1)]


class PickPlacePoses(BaseModel):
    """Ready and pick poses of every job, in rad."""

    ready: Pose
    pick: Pose


class PickPlace(BaseModel):
    """Parameters that depend on the arm and its workcell. The node reads all other parameters itself."""

    joints: tuple[str, ...]
    """Joints of the arm, without the hand, in the order of all poses."""
    poses: PickPlacePoses
    grades: tuple[str, ...]
    bins: dict[str, Pose]
    """Pose above the bin of each grade, in rad."""
    hand_open_m: Position
    """Position of the open hand, in m, or in rad if the hand has a revolute joint."""
    hand_closed_m: Position
    arm_controller: str = ARM
    hand_controller: str = HAND

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        homeless = [grade for grade in self.grades if grade not in self.bins]
        short = [name for name, pose in self.all_poses().items() if len(pose) != len(self.joints)]
        if homeless or short:
            problems = [f"grade {grade} has no pose under bins" for grade in homeless]
            problems += [f"{name} must have {len(self.joints)} numbers, one per joint" for name in short]
            raise ValueError("; ".join(problems))
        self.settings()  # This method raises ValueError if the node would reject the parameters.
        return self

    def all_poses(self) -> dict[str, Pose]:
        """Return every pose, keyed by its name in the file."""
        bins = {f"bins.{grade}": pose for grade, pose in self.bins.items()}
        return {"poses.ready": self.poses.ready, "poses.pick": self.poses.pick, **bins}

    def settings(self) -> "JobSettings":
        """Return the settings of the node, with default times."""
        from pick_place.settings import JobSettings

        return JobSettings(
            joints=self.joints,
            ready_rad=self.poses.ready,
            pick_rad=self.poses.pick,
            bins_rad={grade: self.bins[grade] for grade in self.grades},
            hand_open_m=self.hand_open_m,
            hand_closed_m=self.hand_closed_m,
            arm_controller=self.arm_controller,
            hand_controller=self.hand_controller,
        )


def load_pick_place(path: Path, namespace: str = "") -> PickPlace:
    """Read the parameters of the arm's node in a namespace. If there are several arms, use the first one.

    Raises ArmFileError with the file and line of every error.
    """
    return next(iter(load_pick_places(path, namespace).values()))


def load_pick_places(path: Path, namespace: str = "") -> dict[str, PickPlace]:
    """Read the parameters of all nodes in a namespace, keyed by node name, in alphabetical order.

    A robot with several arms has one node for each arm, such as ``left_vision_pick_place_controller``. Raises
    ArmFileError with the file and line of every error.
    """
    if not path.exists():
        raise ArmFileError(
            f"{path} is missing: demo, simulate and bench arm need its poses. Write the file as described in "
            "docs/arms/README.md, or use servoloop up, which does not need the file"
        )
    sections = Sections.read(path, namespace, ArmFileError)
    if sections.concerns(NODE):
        return {NODE: _read(sections, NODE)}
    nodes = sorted(node for node in sections.nodes() if node.endswith(f"_{NODE}"))
    if not nodes:
        name = f"/**/{NODE}" if namespace else NODE
        raise ArmFileError(f"{path}:1: {namespace}/{NODE} is missing: put the parameters under '{name}: {PARAMETERS}:'")
    return {node: _read(sections, node) for node in nodes}


def arm_jobs(path: Path, namespace: str = "") -> dict[str, PickPlace]:
    """Read the parameters of all nodes, keyed by arm name such as ``left``; if there is only one arm, its key is "".

    Raises ArmFileError.
    """
    return {node.removesuffix(NODE).rstrip("_"): job for node, job in load_pick_places(path, namespace).items()}


def _read(sections: Sections, node: str) -> PickPlace:
    try:
        return PickPlace.model_validate(sections.of(node))
    except ValidationError as error:
        raise ArmFileError("\n".join(mistakes(sections, error, (node, PARAMETERS), node))) from error
