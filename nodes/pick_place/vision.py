"""The checks of a vision message: its apple, and whether it is fresh. No ROS."""

from collections.abc import Iterable

from nodes.pick_place.settings import normal_grade


def candidate(grades: Iterable[str]) -> str | None:
    """The grade to pick for: of the first apple that has one. The camera's order is its ranking."""
    return next((grade for grade in map(normal_grade, grades) if grade), None)


def reason_not_fresh(stamp_s: float, now_s: float, max_age_s: float) -> str | None:
    """Why a message with this stamp is no news, or None if it is; seconds on the node's clock."""
    age_s = now_s - stamp_s
    if stamp_s == 0.0:
        return "its header has no stamp (by hand: header: auto)"
    if age_s >= max_age_s:
        return f"it is {age_s:.1f} s old; news is younger than {max_age_s:g} s"
    if age_s <= -max_age_s:  # it would stay news for as long as the clocks differ
        return f"its stamp is {-age_s:.1f} s in the future; compare the clocks"
    return None
