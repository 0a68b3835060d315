"""Parse XML, and record the file and line of each element."""

from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

_PLACE: Final = " place"
"""Name of the attribute that stores the file and line. XML names cannot contain a space, so no other attribute has this
name.
"""


_DYNAMICS: Final = frozenset(
    {"damping", "friction", "k_position", "k_velocity", "soft_lower_limit", "soft_upper_limit"}
)
"""Numeric attributes of dynamics and soft limits. Most of these attributes are read only by other programs."""
_SIZES: Final = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "box": {"size": 3},
    "mesh": {"scale": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "color": {"rgba": 4},
}
"""Number of values in the attributes of poses and shapes, keyed by tag and attribute."""
_LARGEST: Final = 1e6
"""Highest accepted value in a pose or shape, in m. Much higher values overflow the 32-bit floats of meshes."""


def parse_xml(text: str, file: str) -> Element:
    """Parse a document. Raises xml.parsers.expat.ExpatError if the XML is invalid.

    Args:
        text: The document.
        file: File name, which ``place`` reports with the line.
    """
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
    """Return the file and line of an element that ``parse_xml`` created."""
    return element.get(_PLACE, "")


def is_xacro(root: Element) -> bool:
    """Return whether a document contains xacro macros or expressions."""
    return any(
        "xacro}" in element.tag or "xacro:" in element.tag or any("${" in value for value in element.attrib.values())
        for element in root.iter()
    )


def number_problems(root: Element) -> list[str]:
    """List invalid numbers with their file and line, including numbers that only other programs read."""
    parts = [element for tag in ("link", "joint", "material") for one in root.findall(tag) for element in one.iter()]
    return [
        f'{element.tag} {key} must be {_wanted(count)}, not "{text}" ({place(element)})'
        for element in parts
        for key, text in element.attrib.items()
        if (count := _SIZES.get(element.tag, {}).get(key, int(key in _DYNAMICS))) and not _are_numbers(text, count)
    ]


def _wanted(count: int) -> str:
    return f"a finite number up to {_LARGEST:g}" if count == 1 else f"{count} finite numbers up to {_LARGEST:g}"


def _are_numbers(text: str, count: int) -> bool:
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        return False
    return len(values) == count and all(abs(value) <= _LARGEST for value in values)
