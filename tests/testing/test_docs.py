"""docs/test-your-robot.md shows the package in docs/examples, and the tests of the package find the bug."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import DOCS, ROOT, code, codes, commands, named

PAGE = "test-your-robot.md"
TEXT = (DOCS / PAGE).read_text()
PACKAGE = DOCS / "examples" / "level_hand"
FILES = dict(re.findall(r"^`([\w/.]+)`:\n\n```\w+\n(.*?)```", TEXT, re.DOTALL | re.MULTILINE))
*SOURCES, REACH, BUS, NODE = codes(PAGE, "python")


def pytest_in(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def mend(folder: Path, diff: str) -> None:
    subprocess.run(["patch", "-p1", "--fuzz=0"], cwd=folder, input=diff, text=True, check=True, capture_output=True)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return Path(shutil.copytree(PACKAGE, tmp_path / "level_hand", ignore=shutil.ignore_patterns("__pycache__")))


@pytest.mark.runs(*named(PAGE, "yaml", "toml"), f"{PAGE} python 1", f"{PAGE} python 2")
def test_page_shows_every_file_unchanged() -> None:
    there = {str(path.relative_to(PACKAGE)): path.read_text() for path in PACKAGE.rglob("*.*") if path.is_file()}
    shown = {name: text for name, text in there.items() if not name.endswith((".pyc", "__init__.py"))}
    assert shown == FILES
    assert {*FILES.values()} == {*SOURCES, *codes(PAGE, "toml"), *codes(PAGE, "yaml")}


@pytest.mark.runs(*commands(PAGE), f"{PAGE} diff 1")
def test_example_tests_find_the_bug_and_pass_once_it_is_fixed(package: Path) -> None:
    assert commands(PAGE) == [f"cd {PACKAGE.relative_to(ROOT)}", "pytest"]
    ran = pytest_in(package)
    assert ran.returncode == 1 and "1 failed, 12 passed" in ran.stdout, ran.stdout
    (words,) = re.findall(r"```\n(stays level.*?)```", TEXT, re.DOTALL)
    assert words in ran.stdout
    (again,) = re.findall(r"pytest '(.*)'\n$", words)
    assert pytest_in(package, again).returncode == 1
    mend(package, code(PAGE, "diff"))
    found = re.findall(r"^FAILED (\S+)", ran.stdout, re.MULTILINE)
    ran = pytest_in(package, *found)
    assert ran.returncode == 0 and "1 passed" in ran.stdout, ran.stdout


@pytest.fixture
def reach(tmp_path: Path) -> Path:
    """Return the file that contains a controller that accepts goals, and its test."""
    path = tmp_path / "test_reach.py"
    path.write_text(REACH)
    return path


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} python 3", f"{PAGE} diff 2")
def test_invariants_name_the_controller_with_false_success(reach: Path) -> None:
    ran = pytest_in(reach.parent)
    (words,) = re.findall(r"```\n(success is true.*?)```", TEXT, re.DOTALL)
    assert ran.returncode == 1 and words in ran.stdout, ran.stdout
    mend(reach.parent, code(PAGE, "diff", 2))
    ran = pytest_in(reach.parent)
    assert ran.returncode == 0 and "1 passed" in ran.stdout, ran.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "report"),
    [
        (("        self.canceled = handle\n", "        pass\n"), "cancels are followed: a goal canceled at "),
        (("    arm.cancel(goal)\n", ""), "cancels are followed: the condition of this invariant never occurred"),
    ],
    ids=["cancels are ignored", "nothing is canceled"],
)
def test_second_invariant_of_the_page_is_needed(reach: Path, change: tuple[str, str], report: str) -> None:
    mend(reach.parent, code(PAGE, "diff", 2))
    assert change[0] in reach.read_text()
    reach.write_text(reach.read_text().replace(*change))
    ran = pytest_in(reach.parent)
    assert ran.returncode == 1 and report in ran.stdout, ran.stdout


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} python 4", f"{PAGE} python 5")
@pytest.mark.parametrize("program", [BUS, NODE], ids=["bus", "ROS"])
def test_a_client_and_a_node(program: str, tmp_path: Path) -> None:
    if "rclpy" in program:
        pytest.importorskip("rclpy")
    (tmp_path / "test_mine.py").write_text(program)
    ran = pytest_in(tmp_path)
    assert ran.returncode == 0 and "1 passed" in ran.stdout, ran.stdout
