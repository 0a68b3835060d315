"""Tests that every command and code block of README and docs/ is run by a test, or that the page explains why not."""

import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import typer

from servoloop.cli import app
from tests.marked import ROOT, marked
from tests.pages import SHELL, blocks, pages

TO_RUN = {what for page in pages() for block in blocks(page) for what in block.to_run}
NOT_RUN = {
    "install.md": 1,
    "lerobot.md": 1,
    "ros2.md": 3,
    "ros2-control-host.md": 1,
    "moveit.md": 4,
    "several-arms.md": 1,
}
"""Number of blocks per page that need a whole ROS 2 installation or change the machine."""
INLINE = re.compile(r"(?<!`)`servoloop ([^`]+)`(?!`)")
"""Pattern of a command in the text of a page."""


@pytest.fixture(scope="module")
def tests_of(request: pytest.FixtureRequest) -> dict[str, list[str]]:
    """Return the commands and blocks that tests run, according to their markers. Without ROS, half of these tests are
    missing."""
    pytest.importorskip("rclpy")
    files = [path for path in sorted((ROOT / "tests").rglob("test_*.py")) if "mark.runs(" in path.read_text()]
    return marked(request.config, "runs", files)


def test_every_command_and_code_block_is_run(tests_of: dict[str, list[str]]) -> None:
    """Each command or block that this test reports needs a test with ``@pytest.mark.runs(...)``, as described in
    tests/pages.py."""
    assert sorted(TO_RUN - tests_of.keys()) == []


def test_every_mark_names_an_existing_command_or_block(tests_of: dict[str, list[str]]) -> None:
    assert {what: tests for what, tests in tests_of.items() if what not in TO_RUN} == {}


def test_only_the_known_blocks_are_left_out() -> None:
    assert Counter(block.page for page in pages() for block in blocks(page) if block.not_run) == NOT_RUN


@pytest.mark.parametrize("page", pages())
def test_no_command_hides_in_a_block_of_another_language(page: str) -> None:
    for block in blocks(page):
        if block.language != SHELL:
            assert not re.search(r"^(servoloop|python|make|pytest|ros2) ", block.text, re.MULTILINE), block.name


@pytest.mark.parametrize("page", pages())
def test_every_fence_is_recognized(page: str) -> None:
    """Indented fences, and fences with more than a language, would not be found."""
    fences = [line for line in pages()[page].read_text().splitlines() if "```" in line]
    assert len(fences) == 2 * len(blocks(page)), fences


def verb_of(words: list[str]) -> tuple[Any, list[str]]:
    """Return the full name of the command with its groups, and its arguments."""
    command: Any = typer.main.get_command(app)
    while words and words[0] in getattr(command, "commands", {}):
        command, words = command.commands[words[0]], words[1:]
    return command, words


@pytest.mark.parametrize("page", pages())
def test_commands_in_the_text_exist_with_their_options(page: str) -> None:
    for text in INLINE.findall(re.sub(r"\s+", " ", pages()[page].read_text())):
        verb, rest = verb_of(text.split())
        assert not hasattr(verb, "commands") or not re.match(r"[a-z]", " ".join(rest)), f"servoloop {text}"
        known = {option for parameter in verb.params for option in (*parameter.opts, *parameter.secondary_opts)}
        asked = set(re.findall(r"(?<!\S)--[a-z-]+", text))
        assert asked <= known | {"--help"}, f"servoloop {text}"


def test_pages_are_found() -> None:
    assert {"README.md", "index.md", "arms/so101.md"} <= pages().keys()
    assert all(isinstance(path, Path) for path in pages().values())
