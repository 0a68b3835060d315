"""A YAML file that stores the EEPROM of virtual servos between runs. The file has one entry per joint's servo.

Entries are keyed by joint, because the ID is part of the EEPROM and all factory-new servos have the same ID.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from pydantic import BaseModel, ConfigDict, Field

from drivers.driver_errors import DriverError
from hal.plausible import Number, RegisterValue
from hal.yaml_file import load
from hal.yaml_nodes import compose
from sim_backend.flash import Flash
from sim_backend.line.line import ServoLine
from sim_backend.servos.generic.packet_servo import WiredServo

_HEADER: Final = (
    "# EEPROM of virtual servos. The servos write this file while they run: stop them before you edit it.\n"
)


class EepromFileError(DriverError):
    """Raised if the EEPROM file is damaged, belongs to another arm, or cannot be written."""


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid")

    joint: str
    model: str
    registers: dict[str, RegisterValue]
    bytes: dict[Number, Annotated[Number, Field(ge=0, le=255)]] = Field(default_factory=dict)
    """Bytes at addresses that do not belong to a named register, keyed by address."""
    defaults: Annotated[str, Field(pattern=r"^([0-9a-f]{2})*$")] = ""
    """Settings that a factory reset restores, in hexadecimal; empty for the factory values."""


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    servos: list[_Entry]


class _Owner:
    """One servo and its entry in the file."""

    def __init__(self, joint: str, servo: WiredServo) -> None:
        self.joint, self.servo = joint, servo
        self._fresh = servo.memory.flash

    def take(self, entry: _Entry) -> None:
        """Load the entry into the servo and restart the servo. Raises ValueError if the entry belongs to a different
        servo."""
        model, memory = self.servo.model.name, self.servo.memory
        if entry.model != model:
            raise ValueError(f"the model in the file is {entry.model}, but the arm has an {model}")
        defaults = bytes.fromhex(entry.defaults) or self._fresh.defaults
        if len(defaults) != len(self._fresh.defaults):
            raise ValueError(f"defaults has {len(defaults)} bytes instead of {len(self._fresh.defaults)}")
        settings = memory.kept.settings(self._fresh.settings, entry.registers, entry.bytes)
        try:
            memory.flash = Flash(settings, defaults)
        except LookupError:
            raise ValueError("the servo does not support this baud_rate") from None
        self.servo.power_cycle()

    def entry(self) -> dict[str, Any]:
        """Return the file entry for the servo."""
        flash, kept = self.servo.memory.flash, self.servo.memory.kept
        data: dict[str, Any] = {"joint": self.joint, "model": self.servo.model.name}
        data["registers"] = kept.words(flash.settings)
        if nameless := kept.nameless(flash.settings):
            data["bytes"] = nameless
        if flash.defaults != self._fresh.defaults:
            data["defaults"] = flash.defaults.hex()
        return data


class EepromFile:
    """The EEPROM file and its servos."""

    def __init__(self, path: Path, owners: list[_Owner]) -> None:
        """Load the file if it exists, and then write it back. Raises EepromFileError."""
        self._path, self._owners = path, owners
        if path.exists():
            self._read()
        self._written: list[Flash] = []
        self.save_changes()

    def _read(self) -> None:
        owners = {owner.joint: owner for owner in self._owners}
        entries, file = load(self._path, _File, EepromFileError).servos, compose(self._path, EepromFileError)
        for number, entry in enumerate(entries):
            owner, place = owners.pop(entry.joint, None), file.place(("servos", number))
            if owner is None:
                raise EepromFileError(
                    f"{place}: {entry.joint} has no servo, or the file has two entries for it: choose this arm's file"
                )
            try:
                owner.take(entry)
            except ValueError as error:
                raise EepromFileError(f"{place}: {entry.joint}: {error}. Correct it, or choose another file") from None

    def save_changes(self) -> None:
        """Write the file if any value has changed.

        The text is first written to a temporary file, so the EEPROM file is always complete.
        """
        flash = [owner.servo.memory.flash for owner in self._owners]
        if flash == self._written:
            return
        text = _HEADER + yaml.safe_dump({"servos": [owner.entry() for owner in self._owners]}, sort_keys=False)
        partial = self._path.with_name(self._path.name + ".part")
        try:
            partial.write_text(text)
            partial.replace(self._path)
        except OSError as error:
            raise EepromFileError(f"cannot write {self._path}: {error.strerror}") from error
        self._written = flash


def keep_eeprom(path: Path, lines: Iterable[ServoLine[Any]]) -> None:
    """Load the settings of all servos on these buses from ``path``, and from then on save them to the same file.

    Raises EepromFileError if the file is damaged, belongs to other servos, or cannot be written.
    """
    lines = list(lines)
    pairs = [pair for line in lines for pair in zip(line.rig.plant.couplings, line.servos, strict=True)]
    eeprom = EepromFile(path, [_Owner(coupling.joint, servo) for coupling, servo in pairs])
    for line in lines:
        line.after_instructions = eeprom.save_changes
