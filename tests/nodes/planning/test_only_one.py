"""Of two planning servers the newer one ends, even if the older one discovers it first."""

import pytest

from nodes.planning.only_one import NEW_CHECKS, PATIENT_CHECKS, Seniority


def checks_until_end(checks_alone: int, *servers: int) -> int | None:
    """Return the number of checks with other servers until this server ends, and None if it runs on."""
    seniority = Seniority()
    assert not any(seniority.must_end(1) for _ in range(checks_alone))
    ends = [number for number, count in enumerate(servers, 1) if seniority.must_end(count)]
    return ends[0] if ends else None


@pytest.mark.parametrize(
    ("checks_alone", "servers", "ends_after"),
    [
        pytest.param(0, [2], 1, id="new server"),
        pytest.param(NEW_CHECKS - 1, [2], 1, id="new server that discovers the other late"),
        pytest.param(NEW_CHECKS, [2, 2, 2, 1, 1, 1], None, id="old server whose rival ends"),
        pytest.param(NEW_CHECKS, [2] * 10, PATIENT_CHECKS, id="old server whose rival stays"),
        pytest.param(NEW_CHECKS, [2, 1] * 10, None, id="rivals that end again and again"),
        pytest.param(NEW_CHECKS, [1] * 10, None, id="only server"),
    ],
)
def test_newer_server_ends_first(checks_alone: int, servers: list[int], ends_after: int | None) -> None:
    assert checks_until_end(checks_alone, *servers) == ends_after
