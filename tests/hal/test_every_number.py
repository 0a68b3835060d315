"""Every number of every file that users write: truth values are not numbers, and each number has a plausible range."""

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
"""A number may stand alone, in a list, and in a mapping, by name or by number."""


def models() -> list[type[BaseModel]]:
    """The models of all files, by name."""
    for package in PACKAGES:
        for module in walk_packages(package.__path__, f"{package.__name__}."):
            if "ray_workers" not in module.name and not module.name.endswith("__main__"):
                import_module(module.name)
    return sorted({*_subclasses(BaseModel)}, key=lambda one: f"{one.__module__}.{one.__qualname__}")


def _subclasses(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    roots = tuple(package.__name__ for package in PACKAGES)
    for one in model.__subclasses__():
        yield from _subclasses(one)
        if one.__module__.startswith(roots):
            yield one


MODELS = models()


def read(field: FieldInfo, value: Any) -> list[Any]:
    """What the field makes of the value, in each shape that it takes."""
    adapter: TypeAdapter[Any] = TypeAdapter(Annotated[(field.annotation, None, *field.metadata)])
    found = []
    for shape in SHAPES:
        try:
            found.append(adapter.validate_python(shape(value)))
        except (ValidationError, TypeError):
            continue
    return [] if "Any" in str(field.annotation) else found  # parameters of controllers, which have models of their own


def numbers(value: Any) -> Iterator[int | float]:
    """Yields the numbers within a value; a truth value is none."""
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list | tuple):
        for part in value:
            yield from numbers(part)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


@pytest.mark.parametrize("model", MODELS, ids=lambda one: one.__qualname__)
def test_a_field_takes_neither_truth_values_nor_nonsense_for_a_number(model: type[BaseModel]) -> None:
    for name, field in model.model_fields.items():
        for nonsense in (True, math.nan, math.inf, -math.inf, 1e308, -1e308, 10**30, -(10**30)):
            taken = [number for one in read(field, nonsense) for number in numbers(one) if number != 7]
            assert not taken, f"{name} takes {nonsense}"


def test_the_models_of_all_kinds_of_files_are_looked_at() -> None:
    names = {model.__qualname__ for model in MODELS}
    assert {"JointFile", "CalibratedJoint", "LerobotJoint", "MotionFile", "Scenario", "Schedule", "Silent"} <= names
    assert {"TrajectoryParameters", "GripperParameters", "Passport", "PosesFile", "PickPlace", "JointPlan"} <= names
