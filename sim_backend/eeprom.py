"""A file that keeps the EEPROM of virtual servos between runs: YAML, an entry for the servo of each joint.

By the joint, because the ID is in the EEPROM itself, and factory-new servos all have the same.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from pydantic import BaseModel, ConfigDict, Field

from drivers.errors import DriverError
from hal.plausible import Number, RegisterValue
from hal.yaml_file import load
from hal.yaml_nodes import compose
from sim_backend.flash import Flash
from sim_backend.line.line import ServoLine
from sim_backend.servos.generic.packet_servo import WiredServo

_HEADER: Final = "# EEPROM of virtual servos. Written while they run: edit it when they do not.\n"


class EepromError(DriverError):
    """The file is broken, is another arm's, or cannot be written."""


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid")

    joint: str
    model: str
    registers: dict[str, RegisterValue]
    bytes: dict[Number, Annotated[Number, Field(ge=0, le=255)]] = Field(default_factory=dict)
    """Those without a name, by address."""
    defaults: Annotated[str, Field(pattern=r"^([0-9a-f]{2})*$")] = ""
    """What a factory reset brings back, in hexadecimal; empty: what it is from the factory."""


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    servos: list[_Entry]


class _Owner:
    """One servo and its entry."""

    def __init__(self, joint: str, servo: WiredServo) -> None:
        self.joint, self.servo = joint, servo
        self._fresh = servo.memory.flash

    def take(self, entry: _Entry) -> None:
        """Be the servo of this entry, after a power-off. Raises ValueError where it is another."""
        model, memory = self.servo.model.name, self.servo.memory
        if entry.model != model:
            raise ValueError(f"the file's servo is a {entry.model}, the arm's a {model}")
        defaults = bytes.fromhex(entry.defaults) or self._fresh.defaults
        if len(defaults) != len(self._fresh.defaults):
            raise ValueError(f"defaults has {len(defaults)} bytes instead of {len(self._fresh.defaults)}")
        settings = memory.kept.settings(self._fresh.settings, entry.registers, entry.bytes)
        try:
            memory.flash = Flash(settings, defaults)
        except LookupError:
            raise ValueError("baud_rate is none that it knows") from None
        self.servo.power_cycle()

    def entry(self) -> dict[str, Any]:
        """What the file says of it."""
        flash, kept = self.servo.memory.flash, self.servo.memory.kept
        told: dict[str, Any] = {"joint": self.joint, "model": self.servo.model.name}
        told["registers"] = kept.words(flash.settings)
        if nameless := kept.nameless(flash.settings):
            told["bytes"] = nameless
        if flash.defaults != self._fresh.defaults:
            told["defaults"] = flash.defaults.hex()
        return told


class Eeprom:
    """The file, and the servos that it is of."""

    def __init__(self, path: Path, owners: list[_Owner]) -> None:
        """Take from the file what is in it, and write it. Raises EepromError."""
        self._path, self._owners = path, owners
        if path.exists():
            self._read()
        self._written: list[Flash] = []
        self.save_changes()

    def _read(self) -> None:
        owners = {owner.joint: owner for owner in self._owners}
        entries, file = load(self._path, _File, EepromError).servos, compose(self._path, EepromError)
        for number, entry in enumerate(entries):
            owner, place = owners.pop(entry.joint, None), file.place(("servos", number))
            if owner is None:
                raise EepromError(f"{place}: {entry.joint} has no servo, or two entries: another arm's?")
            try:
                owner.take(entry)
            except ValueError as error:
                raise EepromError(f"{place}: {entry.joint}: {error}. Mend the file, or name another") from None

    def save_changes(self) -> None:
        """Write the file, if anything in it has changed: beside it first, so that it is never half there."""
        flash = [owner.servo.memory.flash for owner in self._owners]
        if flash == self._written:
            return
        text = _HEADER + yaml.safe_dump({"servos": [owner.entry() for owner in self._owners]}, sort_keys=False)
        partial = self._path.with_name(self._path.name + ".part")
        try:
            partial.write_text(text)
            partial.replace(self._path)
        except OSError as error:
            raise EepromError(f"cannot write {self._path}: {error.strerror}") from error
        self._written = flash


def keep_eeprom(path: Path, lines: Iterable[ServoLine[Any]]) -> None:
    """Let the servos of these lines begin with what ``path`` keeps, and keep there what they save from now on.

    Raises EepromError where the file is broken, of other servos, or cannot be written.
    """
    lines = list(lines)
    pairs = [pair for line in lines for pair in zip(line.rig.plant.couplings, line.servos, strict=True)]
    eeprom = Eeprom(path, [_Owner(coupling.joint, servo) for coupling, servo in pairs])
    for line in lines:
        line.after_instructions = eeprom.save_changes
