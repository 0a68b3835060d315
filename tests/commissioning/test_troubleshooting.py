"""Every row of docs/troubleshooting.md names existing findings and tests, and its script runs."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from commissioning.doctor.findings import KINDS
from commissioning.scan.problems import Kind as ScanKind
from drivers.servos import sts
from tests.commissioning.patient import Patient
from tests.commissioning.test_doctor_faults import FIRST
from tests.pages import DOCS, code

HOME = Path(__file__).parents[2]
NAME = "troubleshooting.md"
PAGE = (DOCS / NAME).read_text()
AILMENTS = {case[0].__name__: case for case in FIRST}
PROVOKED = 32


class Row(NamedTuple):
    number: int
    symptom: str
    says: str
    tests: tuple[str, ...]

    @property
    def ids(self) -> set[str]:
        """IDs of the findings that the row names."""
        return set(re.findall(r"`([a-z_]+)`", self.says))


def _row(line: str) -> Row:
    number, symptom, says, tests = (cell.strip() for cell in line.strip("|").split(" | "))
    return Row(int(number), symptom, says, tuple(re.findall(r"`([^`]+)`", tests)))


ROWS = [_row(line) for line in PAGE.splitlines() if re.match(r"\| \d", line)]


@cache
def functions(path: str) -> frozenset[str]:
    tree = ast.parse((HOME / path).read_text())
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def test_all_thirty_nine_problems_are_listed() -> None:
    assert [row.number for row in ROWS] == list(range(1, 40))
    assert sum(bool(row.tests) for row in ROWS) >= PROVOKED


@pytest.mark.parametrize("row", ROWS, ids=lambda row: str(row.number))
def test_a_row_names_tests_that_exist(row: Row) -> None:
    assert row.tests
    for test in row.tests:
        if "::" not in test:
            assert test in AILMENTS, test
            continue
        path, name = test.split("::")
        function, _, parameter = name.rstrip("]").partition("[")
        assert function in functions(path), test
        assert parameter.partition("-")[0] in (HOME / path).read_text(), test


@pytest.mark.parametrize("row", ROWS, ids=lambda row: str(row.number))
def test_a_row_names_findings_that_its_tests_produce(row: Row) -> None:
    others = {*ScanKind.__args__, "permission", "reboot", "activate"}  # type: ignore[attr-defined]
    assert row.ids <= KINDS.keys() | others, row.ids - KINDS.keys()
    for test in row.tests:
        if test in AILMENTS:
            assert AILMENTS[test][1] in row.ids, (test, AILMENTS[test][1])


def test_every_simulated_problem_has_a_test() -> None:
    """A kind of finding without a test might never be reported."""
    provoked = {case[1] for case in FIRST}
    sources = "".join(
        (HOME / "tests/commissioning" / f"test_doctor_{one}.py").read_text() for one in ("ports", "move", "judge")
    )
    assert {kind for kind in KINDS if kind not in provoked and f'"{kind}"' not in sources} == set()


@pytest.mark.runs(f"{NAME} python 1")
def test_the_script_of_the_page_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    patient = Patient()
    patient.put(3, sts.operating_mode, 1)
    monkeypatch.setattr("commissioning.doctor.doctor._serial", lambda clock, device, baud: patient.open(device, baud))
    monkeypatch.setattr("drivers.clock.MonotonicClock", lambda: patient.clock)
    exec(code(NAME, "python"), {})
    assert "fault joint3 (servo 3)" in capsys.readouterr().out
