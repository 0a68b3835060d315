"""The figures in docs/handling.md match the code. test_handling_over_ros.py runs the commands of that page."""

from controller.guided_motion import FURTHEST, HORIZON_S
from servoloop.manual.buttons import BEGIN_S, GOOD_S, LONGEST_S, REPEATS_HZ
from servoloop.manual.robot_client import SHARE, SLOW
from tests.pages import DOCS

TEXT = " ".join((DOCS / "handling.md").read_text().split())


def test_figures_match_the_code() -> None:
    assert f"at most {SLOW} rad/s (m/s)" in TEXT
    assert SHARE == 0.1 and "a tenth of the joint's velocity limit" in TEXT
    assert f"a motion of {HORIZON_S} s that ends at rest" in TEXT
    assert f"further than {FURTHEST} rad" in TEXT
    assert f"repeats {REPEATS_HZ:.0f} times a second" in TEXT and f"valid for {GOOD_S} s" in TEXT
    assert f"longer than {LONGEST_S:.0f} s" in TEXT
    assert f"after the button has been held for {BEGIN_S} s" in TEXT
