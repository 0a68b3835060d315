"""Changes in the structure of YAML and JSON: keys and values are removed, repeated, swapped, or set to nonsense."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from random import Random
from typing import Any, Final

import yaml

from tests.mutated.nonsense import IN_YAML

PLAIN: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*|/\*\*")
MANY: Final = 3000


class Raw(str):
    """Text that is written without quotes."""


@dataclass(frozen=True, slots=True)
class Anchored:
    """Value with an anchor, so that aliases can refer to it."""

    name: str
    value: Any


class Mapping(list[list[Any]]):
    """List of pairs, each with a key and a value. Unlike in a dict, keys may occur more than once."""


Slot = tuple[list[Any], int]
"""A list, and the index of a value in it."""


def parsed(text: str) -> Any:
    """Return the content of a file as lists and mappings that can be changed."""
    return in_copy(_content(text))


@cache
def _content(text: str) -> Any:
    return _changeable(yaml.safe_load(text))


def _changeable(value: Any) -> Any:
    if isinstance(value, dict):
        return Mapping([[key, _changeable(one)] for key, one in value.items()])
    return [_changeable(one) for one in value] if isinstance(value, list) else value


def written(value: Any, indent: str = "") -> str:
    """Return the text of a file, with mappings in block style and lists in brackets."""
    if isinstance(value, Mapping) and value:
        lines = (f"{indent}{_key(key)}: {_after_key(one, indent)}" for key, one in value)
        return "\n".join(lines) + "\n"
    return f"{indent}{in_line(value)}\n"


def _after_key(value: Any, indent: str) -> str:
    return f"\n{written(value, indent + '  ')}".rstrip() if isinstance(value, Mapping) and value else in_line(value)


def in_line(value: Any) -> str:
    """Return the text of a value on one line, which is also valid JSON."""
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, Anchored):
        return f"&{value.name} {in_line(value.value)}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)}: {in_line(one)}" for key, one in value) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(in_line, value)) + "]"
    return json.dumps(value, ensure_ascii=False, default=str)


def _key(key: Any) -> str:
    if isinstance(key, Raw) or not isinstance(key, str):
        return str(key)
    return key if PLAIN.fullmatch(key) else json.dumps(key)


def slots(value: Any) -> Iterator[Slot]:
    """Yield the list and index of every value within ``value``."""
    if isinstance(value, Mapping):
        for pair in value:
            yield pair, 1
            yield from slots(pair[1])
    elif isinstance(value, list):
        for at, one in enumerate(value):
            yield value, at
            yield from slots(one)


def _lists(value: Any) -> list[list[Any]]:
    """Return every mapping and list that is not empty."""
    found = [value] if isinstance(value, list) and value else []
    return found + [one for holder, at in slots(value) if isinstance(one := holder[at], list) and one]


def _replace(root: Any, chance: Random) -> None:
    holder, at = chance.choice(list(slots(root)))
    holder[at] = Raw(chance.choice(IN_YAML))


def _swap(root: Any, chance: Random) -> None:
    (one, i), (other, j) = (chance.choice(list(slots(root))) for _ in range(2))
    nested = {id(one[i]), id(other[j])} & {id(holder) for slot in (one[i], other[j]) for holder, _ in slots(slot)}
    if not nested:
        one[i], other[j] = in_copy(other[j]), in_copy(one[i])


def in_copy(value: Any) -> Any:
    """Return a copy, so that no value contains itself."""
    if isinstance(value, Mapping):
        return Mapping([[key, in_copy(one)] for key, one in value])
    return [in_copy(one) for one in value] if isinstance(value, list) else value


def _drop(root: Any, chance: Random) -> None:
    values = chance.choice(_lists(root))
    del values[chance.randrange(len(values))]


def _repeat(root: Any, chance: Random) -> None:
    values = chance.choice(_lists(root))
    values.insert(chance.randrange(len(values) + 1), in_copy_of_entry(chance.choice(values)))


def in_copy_of_entry(entry: Any) -> Any:
    """Return a copy of an entry of a mapping or of a list."""
    return [entry[0], in_copy(entry[1])] if isinstance(entry, list) and len(entry) == 2 else in_copy(entry)


def _repeat_often(root: Any, chance: Random) -> None:
    values = chance.choice(_lists(root))
    values += [values[0]] * MANY


def _shuffle(root: Any, chance: Random) -> None:
    chance.shuffle(chance.choice(_lists(root)))


def _rename(root: Any, chance: Random) -> None:
    pairs = [pair for values in _lists(root) if isinstance(values, Mapping) for pair in values]
    if pairs:
        one = chance.choice(pairs)
        one[0] = chance.choice(
            [chance.choice(pairs)[0], f"{one[0]}_", str(one[0]).upper(), Raw(chance.choice(IN_YAML))]
        )


def _nest(root: Any, chance: Random) -> None:
    holder, at = chance.choice(list(slots(root)))
    holder[at] = chance.choice([[holder[at]], Mapping([["value", holder[at]]])])


def _alias(root: Any, chance: Random) -> None:
    (one, i), (other, j) = (chance.choice(list(slots(root))) for _ in range(2))
    one[i] = Anchored("x", in_copy(one[i]))
    other[j] = Raw("*x")


def _merge(root: Any, chance: Random) -> None:
    mappings = [values for values in _lists(root) if isinstance(values, Mapping)]
    if mappings:
        chance.choice(mappings).append([Raw("<<"), chance.choice([in_copy(chance.choice(mappings)), Raw("[1]")])])


CHANGES: Final[tuple[Callable[[Any, Random], None], ...]] = (
    *(_replace, _replace, _replace, _replace, _swap, _drop, _repeat, _shuffle, _rename, _nest, _alias, _merge),
    _repeat_often,
)


def changed(text: str, chance: Random, as_json: bool = False) -> str:
    """Return the text of a file with one to three changes in its structure."""
    root = parsed(text)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        if next(slots(root), None) is not None:
            chance.choice(CHANGES)(root, chance)
    return in_line(root) if as_json else written(root)
