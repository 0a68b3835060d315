"""If two nodes have the same name, the newer node reports the older node immediately, even if the older node discovers
the newer one first."""

import pytest

pytest.importorskip("rclpy")

from nodes.only_one import NEW_CHECKS, PATIENT_CHECKS, Discovery, Seniority

ALONE, NEWCOMER, RIVAL = Discovery.ALONE, Discovery.NEWCOMER, Discovery.RIVAL


@pytest.mark.parametrize(
    ("checks_alone", "nodes", "finding", "after"),
    [
        pytest.param(0, [2], NEWCOMER, 1, id="new node"),
        pytest.param(NEW_CHECKS - 1, [2], NEWCOMER, 1, id="new node that discovers the other late"),
        pytest.param(NEW_CHECKS, [2, 2, 2, 1, 1, 1], ALONE, 0, id="old node whose rival ends"),
        pytest.param(NEW_CHECKS, [2] * 10, RIVAL, PATIENT_CHECKS, id="old node whose rival stays"),
        pytest.param(NEW_CHECKS, [2, 1] * 10, ALONE, 0, id="rivals that end again and again"),
        pytest.param(NEW_CHECKS, [1] * 10, ALONE, 0, id="only node"),
    ],
)
def test_newer_node_reports_the_other_first(
    checks_alone: int, nodes: list[int], finding: Discovery, after: int
) -> None:
    seniority = Seniority()
    assert all(seniority.check(1) is ALONE for _ in range(checks_alone))
    findings = [seniority.check(count) for count in nodes]
    reported = [number for number, found in enumerate(findings, 1) if found is not ALONE]
    assert (findings[reported[0] - 1], reported[0]) == (finding, after) if reported else finding is ALONE
