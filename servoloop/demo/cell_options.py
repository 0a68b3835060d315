"""Options for a demo cell: its arm, the properties of the virtual arm, and the results folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from servoloop.recording.mcap import RecordOption
from servoloop.stack.arm_folders import ArmFolder, find_arm
from servoloop.stack.arm_options import (
    BACKLASH_DEG,
    ArmOption,
    BacklashOption,
    NamespaceOption,
    RobotOption,
    SeedOption,
)
from servoloop.stack.shipped_files import OWN

FIRST_TRAY: Final = 2
"""Default random seed for the apples, used without ``--seed``. With this seed, apples of all grades appear."""


@dataclass(frozen=True, slots=True)
class CellOptions:
    """Options for a cell."""

    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out/demo")
    arm: ArmOption = OWN
    robot: RobotOption = None
    backlash_deg: BacklashOption = BACKLASH_DEG
    seed: SeedOption = None
    record: RecordOption = None
    poses: Annotated[
        bool, typer.Option("--poses", help="Plan motions to tool poses instead of moving to joint positions.")
    ] = False
    namespace: NamespaceOption = ""
    view: Annotated[bool, typer.Option("--view", help="Show the arm in a browser.")] = False

    vision: Annotated[
        bool, typer.Option("--vision", help="Sort twelve apples, graded from camera images, instead of cubes.")
    ] = False

    @property
    def apples(self) -> int | None:
        """Random seed for the apples, or None for cubes."""
        if not self.vision:
            return None
        return FIRST_TRAY if self.seed is None else self.seed

    def found(self) -> ArmFolder:
        """Return the folder of the arm. Raises ArmFileError."""
        return find_arm(self.arm)
