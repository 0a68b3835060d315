"""Tests that the documentation contains the clone address of the project if, and only if, the project has one."""

import re
import tomllib
from collections.abc import Mapping

import pytest

from tests.pages import ROOT, pages

CLONE = re.compile(r"\bgit clone (\S+)")


def address() -> str | None:
    """Return the repository address in pyproject.toml."""
    urls: Mapping[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"].get("urls", {})
    return next((url for name, url in urls.items() if name.lower() in ("repository", "source")), None)


@pytest.mark.parametrize("page", pages())
def test_no_page_names_another_address(page: str) -> None:
    assert set(CLONE.findall(pages()[page].read_text())) <= {address()}


def test_the_readme_has_the_address_of_the_project() -> None:
    assert address() is None or CLONE.findall(pages()["README.md"].read_text()) == [address()]
