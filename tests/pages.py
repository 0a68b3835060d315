"""Commands and code blocks of the documentation, for the tests that run them and for the test of completeness.

The mark ``@pytest.mark.runs`` lists the blocks that a test runs: commands in full, and code blocks by name
(``"hardware.md python 1"``). ``tests/docs/test_every_block_is_run.py`` finds commands and blocks without a test.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
SHELL = "sh"
OUTPUT = ("", "text")
"""Languages of blocks that contain the output of programs, which no test runs."""
_FENCED = re.compile(r"^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE)
_NOT_RUN = re.compile(r"^No test runs this block, because .+$", re.MULTILINE)
_taken: set[str] = set()


@dataclass(frozen=True)
class Block:
    """A fenced block. ``number`` counts the blocks of its language on its page, from 1."""

    page: str
    language: str
    number: int
    text: str
    not_run: bool
    """Whether a note below the block states that no test runs it, and why."""

    @property
    def name(self) -> str:
        return f"{self.page} {self.language} {self.number}"

    @property
    def commands(self) -> list[str]:
        """Lines without comments and without the ampersand that starts a program in the background."""
        lines = (re.sub(r"(\s+#.*|\s*&)$", "", line).strip() for line in self.text.splitlines())
        return [line for line in lines if line]

    @property
    def to_run(self) -> list[str]:
        """Names that a test must list in its marker ``runs``: each command of a shell block, or the name of another
        block."""
        if self.not_run or self.language in OUTPUT:
            return []
        return self.commands if self.language == SHELL else [self.name]


def pages() -> dict[str, Path]:
    """Return all documents by name, which is the path below ``docs/``, and the README."""
    found = {str(path.relative_to(DOCS)): path for path in sorted(DOCS.rglob("*.md"))}
    return {"README.md": ROOT / "README.md"} | found


def blocks(page: str) -> list[Block]:
    """Return all fenced blocks of a page."""
    return list(_blocks(page))


def _blocks(page: str) -> Iterator[Block]:
    text = pages()[page].read_text()
    counted: dict[str, int] = {}
    for found in _FENCED.finditer(text):
        language = found["language"]
        counted[language] = counted.get(language, 0) + 1
        behind = text[found.end() :].lstrip("\n")
        yield Block(page, language, counted[language], found["text"], bool(_NOT_RUN.match(behind)))


def commands(page: str) -> list[str]:
    """Return all commands of a page in their order."""
    return [command for block in blocks(page) if block.language == SHELL for command in block.commands]


def code(page: str, language: str, number: int = 1) -> str:
    """Return a code block for the test that runs it."""
    (block,) = (one for one in blocks(page) if (one.language, one.number) == (language, number))
    _taken.add(block.name)
    return block.text


def codes(page: str, language: str) -> list[str]:
    """Return all code blocks of a language."""
    return [code(page, language, block.number) for block in blocks(page) if block.language == language]


def named(page: str, *languages: str) -> list[str]:
    """Return the names of all code blocks in these languages, for a test that runs all of them."""
    return [block.name for block in blocks(page) if block.language in languages]


def require_taken(marks: Iterable[pytest.Mark]) -> None:
    """Fail if a test has not requested a code block that is listed in its mark."""
    said = {what for mark in marks for what in mark.args}
    said &= {block.name for page in pages() for block in blocks(page)} if said else set()
    assert said <= _taken, f"listed in a mark, but never requested with tests.pages.code: {said - _taken}"
