"""Options of ``servoloop emulate``, except for the arm: build of the virtual arm, faults and output files."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.stack.arm_options import BACKLASH_DEG, BacklashOption, SeedOption

if TYPE_CHECKING:
    from sim_backend.buses.build import Build


@dataclass(frozen=True, slots=True)
class EmulatorOptions:
    """Options of ``servoloop emulate``, except for the arm."""

    backlash_deg: BacklashOption = BACKLASH_DEG
    seed: SeedOption = None
    practice: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Seed for an uncalibrated arm on an empty table, to practice calibration with `servoloop hand`.",
        ),
    ] = None
    box: Annotated[
        bool,
        typer.Option(
            "--box",
            help="Serve factory-new servos: all have ID 1 and none is connected (see `servoloop hand LINK connect`).",
        ),
    ] = False
    eeprom: Annotated[
        Path | None, typer.Option(help="File for the servos' EEPROM: loaded if it exists and updated at every change.")
    ] = None
    faults: Annotated[
        Path | None,
        typer.Option(
            help="YAML file with faults, timed from when the servos are ready (see `servoloop fault --list`)."
        ),
    ] = None
    apples: Annotated[
        int | None,
        typer.Option(min=0, help="Seed for apples that come to the stand one after another, in place of the cube."),
    ] = None
    view: Annotated[
        bool, typer.Option("--view", help="Show the arm in a browser, as `servoloop view --bus LINK` does.")
    ] = False
    pictures: Annotated[Path | None, typer.Option(help="Folder for an image and a video of the arm.")] = None

    def build(self) -> "Build":
        """Return the build of the virtual arm."""
        from sim_backend.buses.build import Build

        practice_seed = 0 if self.box and self.practice is None else self.practice
        return Build(self.backlash_deg, self.seed, practice_seed, self.box, self.apples)
