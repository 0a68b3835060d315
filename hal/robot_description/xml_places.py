"""XML whose elements know the file and the line that they stand in."""

from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

_PLACE: Final = " place"
"""The attribute that holds an element's place. XML itself cannot have a name with a space."""


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
