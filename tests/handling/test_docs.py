"""The figures in docs/handling.md match the code. tests/handling/test_handling_over_ros.py runs its commands."""

from nodes.handling.guided_motion import FURTHEST, HORIZON_S
from nodes.handling.robot_client import SHARE, SLOW
from servoloop.manual.buttons import BEGIN_S, GOOD_S, LONGEST_S, REPEATS_HZ
from tests.pages import DOCS

TEXT = (DOCS / "handling.md").read_text()


def test_the_figures_on_the_page_match_the_code() -> None:
    assert f"{SLOW} rad/s (m/s) at the most" in TEXT
    assert SHARE == 0.1 and "a tenth of the joint's velocity limit" in TEXT
    assert f"a motion of {HORIZON_S} s that ends at rest" in TEXT
    assert f"further than {FURTHEST} rad" in TEXT
    assert f"repeats {REPEATS_HZ:.0f} times a second" in TEXT and f"good for {GOOD_S} s" in TEXT
    assert f"longer than {LONGEST_S:.0f} s" in TEXT and f"move nothing ({BEGIN_S} s)" in TEXT
