"""Options for an arm that a script runs, and the files selected by the options."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from controller.manager_errors import ControllersFileError, ManagerError, PluginError
from drivers.driver_errors import DriverError
from hal.hal_errors import HalError
from servoloop.api.arm_errors import ArmError, ArmSetupError
from servoloop.recording.mcap import check_path
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files

SETUP_ERRORS: Final = (DriverError, HalError, ManagerError, PluginError, ControllersFileError)
"""Errors that prevent an arm from starting. The error messages explain what to do."""


@dataclass(frozen=True, slots=True)
class ArmOptions:
    """Options for an arm that a script runs."""

    arm: str
    """Name or folder of the arm."""
    rate_hz: int | None = None
    """Rate of the control loop, in Hz. If None, the rate in the controllers file is used."""
    controllers: Path | None = None
    """Controllers file to use instead of the arm's own."""
    record: Path | None = None
    """Path of a new recording, if any."""

    def files(self) -> Files:
        """Read and check the files of the arm. Raises ArmSetupError."""
        with setup_errors():
            if self.record is not None:
                check_path(self.record)
            files = read_arm_files(find_arm(self.arm), controllers=self.controllers)
        if self.rate_hz is None:
            return files
        if self.rate_hz <= 0:
            raise ArmSetupError(f"rate_hz must be above 0, not {self.rate_hz}")
        return replace(files, controllers=replace(files.controllers, update_rate_hz=self.rate_hz))


@contextmanager
def setup_errors() -> Iterator[None]:
    """Convert errors about files, ports and servos to ArmSetupError."""
    try:
        yield
    except ArmError:
        raise
    except SETUP_ERRORS as error:
        raise ArmSetupError(str(error)) from error
