"""Messages about the values of a file, in which no term of pydantic remains."""

from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from hal.yaml_file import error_text


class Joint(BaseModel):
    name: str = ""


class One(BaseModel):
    kind: Literal["one"]


class Two(BaseModel):
    kind: Literal["two"]


Kinds = Annotated[One | Two, Field(discriminator="kind")]
Some = Field(min_length=1)
TEXTS: dict[str, tuple[Any, Any, str]] = {
    "a tuple": (tuple[str, ...], "x", "must be a list, not 'x'"),
    "a set": (set[str], 3, "must be a list, not 3"),
    "a frozen set": (frozenset[str], 3, "must be a list, not 3"),
    "a boolean": (bool, "maybe", "must be true or false, not 'maybe'"),
    "a model": (Joint, "x", "must be a mapping, not 'x'"),
    "no entries": (Annotated[tuple[str, ...], Some], [], "must have at least 1 entry, not 0"),
    "too few entries": (Annotated[list[int], Field(min_length=2)], [1], "must have at least 2 entries, not 1"),
    "too many entries": (tuple[int, int], [1, 2, 3], "must have at most 2 entries, not 3"),
    "an empty text": (Annotated[str, Some], "", "must have at least 1 character, not 0"),
    "a long text": (Annotated[str, Field(max_length=2)], "abcd", "must have at most 2 characters, not 4"),
    "a pattern": (Annotated[str, Field(pattern="^a+$")], "b", "must match the pattern '^a+$', not 'b'"),
    "a long number": (int, "9" * 5000, "has too many digits: use a smaller number"),
    "no kind": (Kinds, {}, "has no kind: add the key kind"),
    "an unknown kind": (Kinds, {"kind": "three"}, "has the unknown kind 'three': use one of 'one', 'two'"),
}


@pytest.mark.parametrize(("kind", "value", "text"), TEXTS.values(), ids=TEXTS.keys())
def test_every_kind_of_error_has_a_plain_message(kind: Any, value: Any, text: str) -> None:
    with pytest.raises(ValidationError) as error:
        TypeAdapter(kind).validate_python(value)
    assert error_text(error.value.errors()[0]) == text


def test_a_message_about_an_object_does_not_mention_attributes() -> None:
    with pytest.raises(ValidationError) as error:
        TypeAdapter(Joint).validate_python("x", from_attributes=True)
    assert error_text(error.value.errors()[0]) == "must be a mapping, not 'x'"
