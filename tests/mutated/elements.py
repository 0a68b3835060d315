"""Changes in the structure of XML: elements and attributes are removed, repeated, moved, or filled with nonsense."""

from collections.abc import Callable
from copy import deepcopy
from random import Random
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from tests.mutated.nonsense import IN_XML

MANY: Final = 500


def _parents(root: Element) -> list[Element]:
    return [element for element in root.iter() if len(element)]


def _drop(root: Element, chance: Random) -> None:
    parent = chance.choice(_parents(root))
    del parent[chance.randrange(len(parent))]


def _repeat(root: Element, chance: Random) -> None:
    parent = chance.choice(_parents(root))
    parent.insert(chance.randrange(len(parent)), deepcopy(chance.choice(list(parent))))


def _repeat_often(root: Element, chance: Random) -> None:
    parent = chance.choice(_parents(root))
    child = chance.choice(list(parent))
    if len(list(child.iter())) < 10:
        parent.extend(deepcopy(child) for _ in range(MANY))


def _move(root: Element, chance: Random) -> None:
    parent = chance.choice(_parents(root))
    child = deepcopy(chance.choice(list(parent)))
    chance.choice(list(root.iter())).append(child)


def _rename(root: Element, chance: Random) -> None:
    elements = list(root.iter())
    chance.choice(elements).tag = chance.choice([chance.choice(elements).tag, "other", "gpio", "xacro:macro"])


def _attributes(root: Element) -> list[tuple[Element, str]]:
    return [(element, key) for element in root.iter() for key in element.attrib]


def _replace(root: Element, chance: Random) -> None:
    element, key = chance.choice(_attributes(root))
    element.set(key, chance.choice(IN_XML))


def _replace_part(root: Element, chance: Random) -> None:
    element, key = chance.choice(_attributes(root))
    parts = element.get(key, "").split() or [""]
    parts[chance.randrange(len(parts))] = chance.choice(IN_XML)
    element.set(key, " ".join(parts))


def _swap(root: Element, chance: Random) -> None:
    (one, key), (other, name) = (chance.choice(_attributes(root)) for _ in range(2))
    first, second = one.get(key, ""), other.get(name, "")
    one.set(key, second)
    other.set(name, first)


def _drop_attribute(root: Element, chance: Random) -> None:
    element, key = chance.choice(_attributes(root))
    del element.attrib[key]


def _rename_attribute(root: Element, chance: Random) -> None:
    element, key = chance.choice(_attributes(root))
    element.set(chance.choice(_attributes(root))[1], element.attrib.pop(key))


def _write(root: Element, chance: Random) -> None:
    chance.choice(list(root.iter())).text = chance.choice(IN_XML)


CHANGES: Final[tuple[Callable[[Element, Random], None], ...]] = (
    *(_replace, _replace, _replace, _replace_part, _replace_part, _write, _swap, _drop, _repeat, _move, _rename),
    *(_drop_attribute, _rename_attribute, _repeat_often),
)


def changed(text: str, chance: Random) -> str:
    """Return the text of an XML file with one to three changes in its structure."""
    root = ElementTree.fromstring(text)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        if _parents(root) and _attributes(root):
            chance.choice(CHANGES)(root, chance)
    return ElementTree.tostring(root, encoding="unicode")
