"""User-defined servo models from the file ``servo_models.yaml`` in the robot file's folder.

A model inherits the series and the control table of the supported model specified in ``like``. The model's entry in the
file sets its own data and registers.
"""

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, Self

from pydantic import BaseModel, ConfigDict, Field, RootModel, field_validator, model_validator

from drivers.paths import resolved
from drivers.protocol import v1
from drivers.servos import catalog
from drivers.servos.register import Access, Register, ServoModel, between, merged
from drivers.servos.series import Series
from drivers.servos.voltage import voltage_range
from hal.hal_errors import RobotFileError
from hal.plausible import Amperes, NoTruth, RegisterValue, Speed, StallTorque, Volts
from hal.text_file import exists
from hal.yaml_file import load_with_lines
from hal.yaml_nodes import YamlFile

FILE_NAME: Final = "servo_models.yaml"
SIZES: Final = (1, 2, 4)
_LAST_ADDRESS: Final = {True: 255, False: 167}
"""Largest register address. The key is True for protocol 1.0. The indirect registers of an X-series servo begin at
168."""

Whole = Annotated[int, NoTruth]
Angle = Annotated[float, NoTruth, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RegisterFile(_Strict):
    """Register that the model adds to the control table, or that replaces the register of the same name."""

    address: Whole = Field(ge=0, le=255)
    size: Whole = Field(ge=0, le=255)
    read_only: bool = False
    eeprom: bool = False
    signed: bool = False
    """Whether the register holds a two's complement number."""
    sign_bit: Whole | None = Field(None, ge=1, le=31)
    values: tuple[RegisterValue, RegisterValue] | None = None
    """Smallest and largest values that the servo accepts."""

    @field_validator("size")
    @classmethod
    def _known_size(cls, size: int) -> int:
        if size not in SIZES:
            raise ValueError(f"{size} is not a valid register size: write 1, 2 or 4 (bytes)")
        return size

    @model_validator(mode="after")
    def _sign_fits(self) -> Self:
        if self.sign_bit is None:
            return self
        if self.signed:
            raise ValueError("signed and sign_bit exclude each other: remove one of them")
        bits = 8 * self.size
        if self.sign_bit >= bits:
            raise ValueError(f"a register of {bits} bits has no sign_bit {self.sign_bit}: write 1 to {bits - 1}")
        return self

    @model_validator(mode="after")
    def _range_fits(self) -> Self:
        if self.values is None:
            return self
        lowest, highest = self.values
        fitting = self.register("").fitting
        if lowest > highest:
            raise ValueError(f"the range [{lowest}, {highest}] is empty: write the smallest value first")
        if lowest not in fitting or highest not in fitting:
            raise ValueError(
                f"the range [{lowest}, {highest}] does not fit into {self.size} bytes: write values from "
                f"{fitting.start} to {fitting.stop - 1}"
            )
        return self

    def register(self, name: str) -> Register:
        """Return the register.

        Args:
            name: Name of the register.

        Returns:
            The register with this name.
        """
        access = Access.READ if self.read_only else Access.READ_WRITE
        values = between(*self.values) if self.values else ()
        return Register(name, self.address, self.size, access, self.eeprom, self.sign_bit, self.signed, values)


class ModelFile(_Strict):
    """A servo model. Omitted values are taken from the model in ``like``."""

    like: str
    number: Whole = Field(ge=0, le=65535)
    rated_voltage_v: Volts | None = Field(None, gt=0)
    supply_v: tuple[Volts, Volts] | None = None
    stall_torque_nm: StallTorque | None = None
    stall_current_a: Amperes | None = Field(None, gt=0)
    no_load_speed_rad_s: Speed | None = Field(None, gt=0)
    current_unit_a: Amperes | None = Field(None, gt=0)
    sensor_deg: Angle | None = Field(None, ge=1, le=360)
    """Angle covered by the positions of a potentiometer, in degrees."""
    registers: dict[str, RegisterFile] = {}

    @field_validator("supply_v")
    @classmethod
    def _in_order(cls, supply_v: tuple[float, float] | None) -> tuple[float, float] | None:
        if supply_v and supply_v[0] >= supply_v[1]:
            raise ValueError(f"the range [{supply_v[0]:g}, {supply_v[1]:g}] is empty: write the lowest voltage first")
        return supply_v


class ModelsFile(RootModel[dict[str, ModelFile]]):
    """Content of ``servo_models.yaml``: the models, keyed by name."""


def load_servo_models(folder: Path) -> tuple[ServoModel, ...]:
    """Add the servo models of a folder to the catalog.

    Args:
        folder: Folder of a robot file.

    Returns:
        The models in this folder's ``servo_models.yaml``; none if there is no such file.

    Raises:
        RobotFileError: The file contains errors. The message lists all of them with file and line.
    """
    path = folder / FILE_NAME
    if not exists(path, RobotFileError):
        return ()
    content, source = load_with_lines(path, ModelsFile, RobotFileError)
    models: list[ServoModel] = []
    problems: list[str] = []
    for name, described in content.root.items():
        found = list(_mistakes(name, described, source))
        if not found:
            model, like = _model(name, described), catalog.MODELS[described.like]
            try:
                catalog.add(model, like, resolved(path))
            except ValueError as error:
                found.append(f"{source.place((name, 'number'))}: {error}")
            models.append(model)
        problems += found
    if problems:
        raise RobotFileError("\n".join(problems))
    return tuple(models)


def _mistakes(name: str, described: ModelFile, source: YamlFile) -> Iterator[str]:
    """Yield the errors in one model, each with its file and line."""
    like = catalog.MODELS.get(described.like)
    if like is None or described.like == name:
        advice = catalog.model_advice(described.like, sorted(set(catalog.MODELS) - {name}))
        yield f"{source.place((name, 'like'))}: unknown model {described.like}: {advice}"
        return
    for key, mistake in _wrong_figures(described, like):
        yield f"{source.place((name, key))}: {mistake}"
    for key, mistake in _wrong_registers(described, like):
        yield f"{source.place((name, 'registers', key))}: {mistake}"


def _wrong_figures(described: ModelFile, like: ServoModel) -> Iterator[tuple[str, str]]:
    """Yield the keys of values that do not exist in the series, each with an error message."""
    for key in _figures(described):
        if getattr(like, key, None) is None and key != "supply_v":
            yield key, f"{like.name} has no {key}: remove it"
    if described.sensor_deg is not None and like.positions is None:
        yield "sensor_deg", f"the sensor of {like.name} covers a whole turn: remove sensor_deg"


def _wrong_registers(described: ModelFile, like: ServoModel) -> Iterator[tuple[str, str]]:
    """Yield the names of registers that cannot be in the control table, each with an error message."""
    series = catalog.series_of(like)
    last, fixed = _LAST_ADDRESS[series.protocol.packets is v1], _fixed(series)
    own = {key: one.register(key) for key, one in described.registers.items()}
    for key, register in own.items():
        if register.address + register.size - 1 > last:
            yield key, f"{key} ends after address {last}, the end of the table: correct its address"
        used = fixed.get(key, register)
        if used != register:
            text = f"servoloop uses {key} of {like.name} at address {used.address} with {used.size} bytes"
            yield key, f"{text}: remove it, or add a series (docs/add-a-servo.md)"
    for first, second in _overlaps(merged(catalog.registers_of(like), own.values()), own):
        yield second, f"{second} overlaps {first}: correct its address or size"


def _overlaps(table: tuple[Register, ...], own: Mapping[str, Register]) -> Iterator[tuple[str, str]]:
    """Yield the names of overlapping registers. The user's register comes last."""
    for before, after in pairwise(table):
        if before.address + before.size > after.address:
            first, second = before.name, after.name
            yield (first, second) if second in own else (second, first)


def _fixed(series: Series) -> dict[str, Register]:
    """Return the registers that the bus reads and writes in every servo of a series, keyed by name."""
    named = [value for each in fields(series) if isinstance(value := getattr(series, each.name), Register)]
    block = series.blocks[0]
    shown = [r for r in series.registers if block.address <= r.address < block.address + block.size]
    every = (*named, *shown, *series.goal_block, *series.position_limits)
    return {register.name: register for register in every}


def _figures(described: ModelFile) -> dict[str, Any]:
    """Return the values specified in the file, keyed by their field names in ``ServoModel``."""
    return described.model_dump(exclude_none=True, exclude={"like", "registers", "sensor_deg"})


def _model(name: str, described: ModelFile) -> ServoModel:
    """Return the model described in the file."""
    like = catalog.MODELS[described.like]
    figures: dict[str, Any] = {"supply_v": voltage_range(like)} if described.rated_voltage_v is None else {}
    figures |= _figures(described)
    if described.sensor_deg is not None and like.positions is not None:
        figures["counts_per_turn"] = round(like.positions * 360.0 / described.sensor_deg)
    own = merged(like.own, [one.register(key) for key, one in described.registers.items()])
    return replace(like, name=name, own=own, **figures)
