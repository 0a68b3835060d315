"""Tests that the files and names in docs/architecture.md exist."""

import re

import pytest

from tests.pages import ROOT, pages

TEXT = pages()["architecture.md"].read_text()
QUESTIONS = re.findall(r"^\| (.+\?) \| `([^`]+)` \| `(\w+)` \|$", TEXT, flags=re.MULTILINE)


def test_the_page_answers_ten_questions() -> None:
    assert len(QUESTIONS) == 10


@pytest.mark.parametrize(("question", "file", "name"), QUESTIONS)
def test_each_question_leads_to_a_definition_in_its_file(question: str, file: str, name: str) -> None:
    """The first element is the file, and the second element is the function, class or constant in it."""
    defined = re.compile(rf"^(?:def |class )?{name}\b(?:[(:]| =)", flags=re.MULTILINE)
    assert defined.search((ROOT / file).read_text()), f"{file} does not define {name}: {question}"


def test_every_file_on_the_page_exists() -> None:
    named = set(re.findall(r"`([\w./]+/[\w.]*\w\.\w+)`", TEXT))
    assert len(named) > 40
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
