"""docs/handling.md says what the code does; tests/handling/test_handling_over_ros.py runs its commands."""

from nodes.handling.guided_motion import FURTHEST, HORIZON_S
from nodes.handling.robot_client import SHARE, SLOW
from tests.pages import DOCS

TEXT = (DOCS / "handling.md").read_text()


def test_the_figures_are_those_of_the_code() -> None:
    assert f"{SLOW} rad/s (m/s) at the most" in TEXT
    assert SHARE == 0.1 and "a tenth of the joint's velocity limit" in TEXT
    assert f"a motion of {HORIZON_S} s that ends at rest" in TEXT
    assert f"further than {FURTHEST} rad" in TEXT
