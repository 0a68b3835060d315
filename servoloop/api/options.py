"""Options for an arm that a script runs, and the files selected by the options."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import Final

from controller.manager_errors import ControllersFileError, ManagerError, PluginError
from drivers.driver_errors import DriverError
from hal.hal_errors import HalError
from hal.plausible import RANGES
from servoloop.api.arm_errors import ArmError, ArmSetupError
from servoloop.api.checks import number_of
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
        return replace(files, controllers=replace(files.controllers, update_rate_hz=_checked_rate(self.rate_hz)))


def _checked_rate(value: object) -> int:
    """Return a rate within the range that controllers files allow, in Hz. Raises ArmSetupError."""
    allowed, rate_hz = RANGES["update_rate"], number_of(value)
    if rate_hz is not None and allowed.lowest <= rate_hz <= allowed.highest and rate_hz.is_integer():
        return int(rate_hz)
    shown = repr(value) if rate_hz is None else f"{rate_hz:g}"
    raise ArmSetupError(f"rate_hz must be a whole number from {allowed.lowest:g} to {allowed.highest:g}, not {shown}")


def check_virtual_arm(seed: object, backlash_deg: object) -> None:
    """Check the options of ``Arm.simulated``. Raises ArmSetupError."""
    if seed is not None and not (isinstance(seed, Integral) and int(seed) >= 0):
        raise ArmSetupError(f"seed must be a whole number of at least 0, not {seed!r}")
    backlash = number_of(backlash_deg)
    if backlash is None or not (math.isfinite(backlash) and backlash >= 0.0):
        raise ArmSetupError(f"backlash_deg must be a finite angle of at least 0, not {backlash_deg!r}")


@contextmanager
def setup_errors() -> Iterator[None]:
    """Convert errors about files, ports and servos to ArmSetupError."""
    try:
        yield
    except ArmError:
        raise
    except SETUP_ERRORS as error:
        raise ArmSetupError(str(error)) from error
