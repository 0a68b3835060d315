"""Tests that every numeric field in user files rejects booleans and implausible values."""

import math
from collections.abc import Iterator
from importlib import import_module
from pkgutil import walk_packages
from typing import Annotated, Any

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

import commissioning
import controller
import hal
import servoloop
import sim_backend

PACKAGES = (commissioning, controller, hal, servoloop, sim_backend)
SHAPES = (
    lambda one: one,
    lambda one: [one],
    lambda one: {"a": one},
    lambda one: {"a": {"a": one}},
    lambda one: {7: one},
)
"""Shapes of a number in a file: single, in a list, and in a mapping by name or by number."""


EXTRAS = ("rclpy", "ompl", "cv2")
"""Optional libraries. No module that defines a pydantic model needs them."""


def models() -> list[type[BaseModel]]:
    """Return the pydantic models of all files, by name. Modules of extras that are not installed are left out."""
    for package in PACKAGES:
        for module in walk_packages(package.__path__, f"{package.__name__}."):
            if "ray_workers" not in module.name and not module.name.endswith("__main__"):
                try:
                    import_module(module.name)
                except ModuleNotFoundError as missing:
                    if missing.name not in EXTRAS:
                        raise
    return sorted({*_subclasses(BaseModel)}, key=lambda one: f"{one.__module__}.{one.__qualname__}")


def _subclasses(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    roots = tuple(package.__name__ for package in PACKAGES)
    for one in model.__subclasses__():
        yield from _subclasses(one)
        if one.__module__.startswith(roots):
            yield one


MODELS = models()


def read(field: FieldInfo, value: Any) -> list[Any]:
    """Return the results of assigning a value to a field, in each shape that the field accepts."""
    adapter: TypeAdapter[Any] = TypeAdapter(Annotated[(field.annotation, None, *field.metadata)])
    found = []
    for shape in SHAPES:
        try:
            found.append(adapter.validate_python(shape(value)))
        except (ValidationError, TypeError):
            continue
    return [] if "Any" in str(field.annotation) else found  # the parameters of controllers have their own models


def numbers(value: Any) -> Iterator[int | float]:
    """Yield all numbers within a value, except for booleans."""
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list | tuple):
        for part in value:
            yield from numbers(part)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


@pytest.mark.parametrize("model", MODELS, ids=lambda one: one.__qualname__)
def test_number_fields_accept_neither_booleans_nor_implausible_numbers(model: type[BaseModel]) -> None:
    for name, field in model.model_fields.items():
        for nonsense in (True, math.nan, math.inf, -math.inf, 1e308, -1e308, 10**30, -(10**30)):
            taken = [number for one in read(field, nonsense) for number in numbers(one) if number != 7]
            assert not taken, f"{name} takes {nonsense}"


def test_the_models_of_all_kinds_of_files_are_tested() -> None:
    names = {model.__qualname__ for model in MODELS}
    assert {"JointFile", "CalibratedJoint", "LerobotJoint", "MotionFile", "Scenario", "Schedule", "Silent"} <= names
    assert {"TrajectoryParameters", "GripperParameters", "Passport", "PosesFile", "PickPlace", "JointPlan"} <= names
