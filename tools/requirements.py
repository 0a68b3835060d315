"""Compare the requirements of pyproject.toml with the versions in requirements.lock."""

import re
import tomllib
from collections.abc import Iterator, Mapping

COMPARISONS = {
    ">=": lambda found, bound: found >= bound,
    "<": lambda found, bound: found < bound,
    "==": lambda found, bound: found == bound,
    "!=": lambda found, bound: found != bound,
}


def requirements(pyproject: str) -> Iterator[str]:
    """Yield all requirements of a pyproject.toml, except for the extra that consists of other extras."""
    content = tomllib.loads(pyproject)
    project = content["project"]
    yield from project["dependencies"]
    for group in (*project["optional-dependencies"].values(), *content["dependency-groups"].values()):
        yield from (line for line in group if not line.startswith(f"{project['name']}["))


def outdated(pyproject: str, locked: Mapping[str, str]) -> str:
    """Return a sentence about the first requirement that the lock file does not satisfy, or an empty string.

    Args:
        pyproject: Text of pyproject.toml.
        locked: Versions in the lock file, keyed by package name.
    """
    for requirement in requirements(pyproject):
        name, bounds = _parsed(requirement)
        version = locked.get(name)
        if version is None or not all(COMPARISONS[sign](_key(version), _key(bound)) for sign, bound in bounds):
            return f"pyproject.toml requires {requirement}, but requirements.lock has {version}: run make lock."
    return ""


def _parsed(requirement: str) -> tuple[str, list[tuple[str, str]]]:
    found = re.fullmatch(r"([\w.-]+)(?:\[.*?\])?((?:(?:>=|<|==|!=)[\d.]+,?)+)(?:;.*)?", requirement)
    if found is None:
        raise ValueError(f"pyproject.toml must give {requirement} a lower bound (>=) or a version (==)")
    name = re.sub(r"[-_.]+", "-", found.group(1)).lower()
    return name, re.findall(r"(>=|<|==|!=)([\d.]+)", found.group(2))


def _key(version: str) -> list[int]:
    """Return the numbers of a version without trailing zeros, so that versions can be compared."""
    numbers = [int(number) for number in re.findall(r"\d+", version)]
    while numbers and not numbers[-1]:
        numbers.pop()
    return numbers
