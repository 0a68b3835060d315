"""Read and write passports: YAML files with every EEPROM register of every servo, keyed by name."""

from pathlib import Path
from typing import Final, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, model_validator

from commissioning.atomic_write import cannot_write, write_whole
from commissioning.commissioning_errors import LARGEST_BAUD, SMALLEST_BAUD, CommissioningError
from commissioning.provision import persistent_registers
from drivers.servos.catalog import MODELS, model_advice
from drivers.servos.register import ServoModel
from hal.plausible import Baud, RegisterValue, ServoId
from hal.text_file import read_text
from hal.yaml_file import load

HEADER: Final = """\
# The EEPROM of every servo on one bus, written by servoloop passport save. The values are raw register values without
# units; docs/servos.md explains them. The previous file has the same name plus .1.
"""
END: Final = "...\n"
"""End marker of a YAML document. If this marker is missing, the file is truncated."""


class PassportError(CommissioningError):
    """A passport cannot be read or cannot be written to a servo. The message tells the user what to do."""


OPTIONAL: Final = {"startup_configuration"}
"""Registers that older passports do not contain."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ServoPassport(_Strict):
    """Contents of the EEPROM of one servo."""

    model: str
    joint: str | None = None
    registers: dict[str, RegisterValue]

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.model not in MODELS:
            raise ValueError(f"unknown model {self.model}: {model_advice(self.model)}")
        known = persistent_registers(MODELS[self.model])
        problems = [f"{self.model} has no persistent register {name}" for name in self.registers if name not in known]
        missing = known.keys() - self.registers.keys() - OPTIONAL
        problems += [f"register {name} is missing" for name in known if name in missing]
        problems += [
            f"{name} must be {known[name].values_text}, not {value}"
            for name, value in self.registers.items()
            if name in known and not known[name].takes(value)
        ]
        number = self.registers.get("model_number", MODELS[self.model].number)
        if number != MODELS[self.model].number:
            problems.append(f"model_number is {number}, but an {self.model} has {MODELS[self.model].number}")
        if problems:
            raise ValueError("; ".join(problems))
        return self

    @property
    def servo_model(self) -> ServoModel:
        """The model of the servo."""
        return MODELS[self.model]


class Passport(_Strict):
    """Contents of a passport file."""

    adapter: str | None = None
    """Serial number of the USB adapter; None if the adapter has none."""
    baud: Baud = Field(ge=SMALLEST_BAUD, le=LARGEST_BAUD)
    servos: dict[ServoId, ServoPassport]
    """Passport of each servo, keyed by ID."""

    @model_validator(mode="after")
    def _has_its_ids(self) -> Self:
        wrong = [key for key, servo in self.servos.items() if servo.registers["id"] != key]
        if wrong:
            raise ValueError("; ".join(f"servo {key}: its id register contains a different ID" for key in wrong))
        return self


def read_passport(path: Path) -> Passport:
    """Read a passport. Raises PassportError listing all errors."""
    text = read_text(path, PassportError)
    truncated = PassportError(
        f"{path}:{len(text.splitlines())}: the file is truncated, because its last line is not {END.strip()}. Use "
        "another copy, or save the passport again"
    )
    is_whole = text.endswith(END)
    if not is_whole and text.startswith(HEADER.splitlines()[0]):  # its other errors are consequences
        raise truncated
    passport = load(path, Passport, PassportError)
    if not is_whole:
        raise truncated
    return passport


def write_passport(path: Path, passport: Passport) -> None:
    """Write a passport atomically, and keep the previous file. Raises PassportError."""
    content = passport.model_dump(exclude_none=True)
    try:
        write_whole(path, HEADER + yaml.safe_dump(content, sort_keys=False, explicit_end=True))
    except OSError as error:
        raise PassportError(cannot_write(path, error)) from error
