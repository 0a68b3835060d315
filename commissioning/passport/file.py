"""The passport file: YAML, one servo after the other, every register of its EEPROM by name."""

from pathlib import Path
from typing import Final, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, model_validator

from commissioning.atomic_write import cannot_write, write_whole
from commissioning.errors import LARGEST_BAUD, SMALLEST_BAUD, CommissioningError
from commissioning.provision import persistent_registers
from drivers.servos.catalog import MODELS
from drivers.servos.register import ServoModel
from hal.plausible import Baud, RegisterValue, ServoId
from hal.text_file import read_text
from hal.yaml_file import load

HEADER: Final = """\
# The EEPROM of every servo on one line, written by servoloop passport save. Values are as the servos hold them, without
# units; docs/servos.md says what each means. The former file is beside it, with .1 behind its name.
"""
END: Final = "...\n"
"""YAML's own end of a document: a file without it was cut off."""


class PassportError(CommissioningError):
    """A passport that cannot be read, or a servo that cannot be made what it says; the text says what to do."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ServoPassport(_Strict):
    """One servo: everything that its EEPROM holds."""

    model: str
    joint: str | None = None
    registers: dict[str, RegisterValue]

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.model not in MODELS:
            raise ValueError(f"unknown model {self.model}: known are {', '.join(MODELS)}")
        known = persistent_registers(MODELS[self.model])
        problems = [f"{self.model} has no persistent register {name}" for name in self.registers if name not in known]
        problems += [f"register {name} is missing" for name in known if name not in self.registers]
        problems += [
            f"{name} takes {known[name].smallest} to {known[name].largest}, not {value}"
            for name, value in self.registers.items()
            if name in known and not known[name].smallest <= value <= known[name].largest
        ]
        number = self.registers.get("model_number", MODELS[self.model].number)
        if number != MODELS[self.model].number:
            problems.append(f"model_number {number} is not that of a {self.model}, {MODELS[self.model].number}")
        if problems:
            raise ValueError("; ".join(problems))
        return self

    @property
    def servo_model(self) -> ServoModel:
        """The servo's model."""
        return MODELS[self.model]


class Passport(_Strict):
    """The whole file."""

    adapter: str | None = None
    """The serial number of the USB adapter, where it has one."""
    baud: Baud = Field(ge=SMALLEST_BAUD, le=LARGEST_BAUD)
    servos: dict[ServoId, ServoPassport]
    """By ID."""

    @model_validator(mode="after")
    def _has_its_ids(self) -> Self:
        wrong = [key for key, servo in self.servos.items() if servo.registers["id"] != key]
        if wrong:
            raise ValueError("; ".join(f"servo {key} has another id in its registers" for key in wrong))
        return self


def read_passport(path: Path) -> Passport:
    """Read a passport. Raises PassportError with every mistake."""
    passport = load(path, Passport, PassportError)
    if not read_text(path, PassportError).endswith(END):
        raise PassportError(f"{path} was cut off: its last line is not {END.strip()}")
    return passport


def write_passport(path: Path, passport: Passport) -> None:
    """Write it whole; the former file is kept. Raises PassportError."""
    content = passport.model_dump(exclude_none=True)
    try:
        write_whole(path, HEADER + yaml.safe_dump(content, sort_keys=False, explicit_end=True))
    except OSError as error:
        raise PassportError(cannot_write(path, error)) from error
