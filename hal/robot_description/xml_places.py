"""XML whose elements know the file and the line that they stand in."""

from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

_PLACE: Final = " place"
"""The attribute that holds an element's place. XML itself cannot have a name with a space."""


_SHAPES: Final = {"xyz", "rpy", "size", "radius", "length", "scale", "rgba"}
_DYNAMICS: Final = {"damping", "friction", "k_position", "k_velocity", "soft_lower_limit", "soft_upper_limit"}
_NUMBERS: Final = frozenset(_SHAPES | _DYNAMICS)
"""Attributes of a URDF that hold numbers and that only other programs read."""


def parse_xml(text: str, file: str) -> Element:
    """Parse a document; ``place`` of its elements names ``file``. Raises xml.parsers.expat.ExpatError."""
    builder = TreeBuilder()
    parser = expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True

    def start(tag: str, attributes: dict[str, str]) -> None:
        builder.start(tag, {**attributes, _PLACE: f"{file}, line {parser.CurrentLineNumber}"})

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(text, True)
    return builder.close()


def place(element: Element) -> str:
    """The file and the line of an element that ``parse_xml`` made."""
    return element.get(_PLACE, "")


def is_xacro(root: Element) -> bool:
    """Whether a document has macros of xacro, or values that xacro computes."""
    return any(
        "xacro}" in element.tag or "xacro:" in element.tag or any("${" in value for value in element.attrib.values())
        for element in root.iter()
    )


def not_finite(root: Element) -> list[str]:
    """The places of numbers that are not finite, also of those that nothing here computes with."""
    return [
        f'{element.tag} {key}="{value}" is not a finite number ({place(element)}): correct it'
        for element in root.iter()
        for key, value in element.attrib.items()
        if key in _NUMBERS and any(part.lower().lstrip("+-") in ("nan", "inf", "infinity") for part in value.split())
    ]
