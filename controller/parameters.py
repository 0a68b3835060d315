"""Define the base class of node parameters. Each controller defines its own parameters next to its code."""

from collections.abc import Iterator, Mapping
from itertools import takewhile
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hal.plausible import MaxMessageSize, NoTruth, UpdateRate

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), NoTruth]
"""A finite number greater than or equal to 0, for parameters of user-written controllers."""


def ros_mistakes(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the dotted name of each value that a ROS parameter cannot hold, with a description of the error.

    For a value without a name, the name of its group is yielded, which is empty for a value of the node itself.
    """
    for key, value in values.items():
        name = f"{prefix}{key}"
        if not all(name.split(".")):
            parent = ".".join(takewhile(bool, name.split(".")))
            yield parent, "has a parameter without a name: give the parameter a name"
        elif isinstance(value, Mapping):
            yield from ros_mistakes(value, f"{name}.")
        elif mistake := _value_mistake(value):
            yield name, mistake


def _value_mistake(value: Any) -> str | None:
    parts = value if isinstance(value, list | tuple) else [value]
    kinds = {type(part) for part in parts}
    if value is None:
        return "has no value: set a value or remove the parameter"
    if strange := kinds - {bool, int, float, str}:
        return f"has a value of type {strange.pop().__name__}, which ROS parameters do not support: use numbers or text"
    if len(kinds) > 1:
        mixed = " and ".join(sorted(kind.__name__ for kind in kinds))
        return f"mixes {mixed} in one list: use one type for all elements, for example 0.0 instead of 0"
    if kinds == {int} and not all(-(2**63) <= part < 2**63 for part in parts):
        return "is outside the 64-bit integer range of ROS parameters: use a smaller number"
    return None


class Parameters(BaseModel):
    """Parameters of a node. The names match those of ros2_control."""

    model_config = ConfigDict(extra="allow", frozen=True)

    @classmethod
    def as_far_as_given(cls, values: Mapping[str, Any]) -> Self:
        """Build the parameters from the given values. Required values may be missing: see ``missing``.

        Args:
            values: Values, keyed by parameter name.

        Returns:
            The parameters. If a required value is missing, the other values are not converted to their types.

        Raises:
            pydantic.ValidationError: A value has any other error.
        """
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            if any(item["type"] != "missing" or len(item["loc"]) > 1 for item in error.errors()):
                raise
        return cls.model_construct(**values)

    def missing(self) -> tuple[str, ...]:
        """Return the required parameters that have no value. A controller cannot be built until all of them are set.

        Returns:
            Names of the parameters.
        """
        fields = type(self).model_fields
        return tuple(name for name, field in fields.items() if field.is_required() and name not in self.__dict__)

    def claims(self) -> tuple[str, ...]:
        """Return the command interfaces that the controller claims while it is active.

        Returns:
            Full names, such as ``joint1/position``.
        """
        return ()

    def unused(self) -> list[str]:
        """Return the parameters that do not have any effect.

        Unknown parameters are logged instead of rejected, because they may be ros2_control parameters.

        Returns:
            Names of the parameters, sorted.
        """
        return sorted(_unknown(self))


def _unknown(model: BaseModel, prefix: str = "") -> Iterator[str]:
    """Yield the dotted name of each unknown parameter, including those in parameter groups."""
    extra = model.model_extra or {}
    for name in (*type(model).model_fields, *extra):
        value = getattr(model, name, None)
        if isinstance(value, BaseModel):
            yield from _unknown(value, f"{prefix}{name}.")
        elif name in extra:
            yield f"{prefix}{name}"


class ManagerParameters(Parameters):
    """Parameters of the controller manager itself."""

    update_rate: UpdateRate = 100  # ros2_control's default
    enforce_command_limits: bool = True
    """Whether ros2_control enforces the command limits. In servoloop, the limits are always enforced, and False only
    causes a warning.
    """
    publish_introspection: bool = False
    """Whether to publish ``~/introspection_data`` and ``~/statistics``."""
    max_message_size: MaxMessageSize = 2_000_000
    """Maximum size of a goal, command or request, in bytes of memory. Larger messages are rejected.

    In 2 MB, a goal can have up to 5000 points for twelve joints, with velocities and accelerations.
    """
