"""Check the apples in a vision message and the message's age. The module imports no ROS package."""

from collections.abc import Iterable

from pick_place.settings import normal_grade


def candidate(grades: Iterable[str]) -> str | None:
    """Return the grade of the first apple that has a grade. The camera sorts the apples by rank."""
    return next((grade for grade in map(normal_grade, grades) if grade), None)


def reason_not_fresh(stamp_s: float, now_s: float, max_age_s: float) -> str | None:
    """Return the reason why a message with this timestamp is too old or invalid, or None.

    Times are in seconds on the node's clock.
    """
    age_s = now_s - stamp_s
    if stamp_s == 0.0:
        return "its header has no stamp (in `ros2 topic pub`, use header: auto)"
    if age_s >= max_age_s:
        return f"it is {age_s:.1f} s old; the maximum age is {max_age_s:g} s"
    if age_s <= -max_age_s:  # If it were accepted, such a message would remain valid as long as the clocks differ.
        return f"its stamp is {-age_s:.1f} s in the future: synchronize the clocks"
    return None
