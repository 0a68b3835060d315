"""Pairs of links that may touch, from an SRDF."""

from xml.etree import ElementTree

from planning.arm_model import Pair, pair
from planning.errors import PlanningError


def srdf_pairs(srdf: str) -> frozenset[Pair]:
    """Return the pairs of links of the <disable_collisions> elements of an SRDF.

    Raises:
        PlanningError: The text is not XML, or an element names fewer than two links.
    """
    try:
        root = ElementTree.fromstring(srdf)
    except ElementTree.ParseError as error:
        raise PlanningError("INVALID_ROBOT_STATE", f"the SRDF is not XML: {error}") from error
    pairs = set()
    for element in root.iter("disable_collisions"):
        one, other = element.get("link1"), element.get("link2")
        if not one or not other:
            raise PlanningError("INVALID_ROBOT_STATE", "a <disable_collisions> of the SRDF needs link1 and link2")
        pairs.add(pair(one, other))
    return frozenset(pairs)
