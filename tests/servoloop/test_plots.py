"""Plots are self-contained SVG elements, with the same bytes for the same numbers."""

import math
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servoloop.plots import MOST, Curve, Panel, Stretch, histogram, points, stacked_bars, thinned, time_series

TIMES_S = [0.05 * i for i in range(41)]
DRAWN = {
    "bars": lambda: stacked_bars(["one", "<two>"], {"good": [1, 0], "bad": [2, 5]}, ["blue", "red"], "runs"),
    "no bars": lambda: stacked_bars([], {"good": []}, ["blue"], "runs"),
    "histogram": lambda: histogram([0, 1, 2], {"good": [0, 0]}, ["blue"], "time (s)", "faults"),
    "points": lambda: points({"good": [(1, 0.5), (2, 0.6)], "bad": []}, ["blue", "red"], "seed", "error (rad)"),
    "series": lambda: time_series(
        TIMES_S,
        [
            Panel("rad", (Curve("joint1", TIMES_S), Curve("joint1", [math.nan] * 41, dashed=True))),
            Panel("m", (Curve("<hand>", TIMES_S),)),
        ],
        [Stretch("silent id=3", 0.5, 1.0)],
        1.5,
    ),
}


@pytest.mark.parametrize("name", DRAWN)
def test_a_plot_is_one_self_contained_and_reproducible_element(name: str) -> None:
    text = DRAWN[name]()
    assert text == DRAWN[name]()
    element = ElementTree.fromstring(text)
    assert element.tag == "{http://www.w3.org/2000/svg}svg"
    links = [value for one in element.iter() for key, value in one.attrib.items() if key.endswith("href")]
    assert all(link.startswith("#") for link in links)


def test_names_and_units_are_text_elements() -> None:
    words = "".join(ElementTree.fromstring(DRAWN["series"]()).itertext())
    assert all(word in words for word in ("joint1", "<hand>", "rad", "silent id=3", "time (s)"))


@given(count=st.integers(0, 3 * MOST), at=st.integers(0, 3 * MOST), height=st.floats(10.0, 20.0))
def test_decimation_keeps_the_extreme_points(count: int, at: int, height: float) -> None:
    group = [(float(x), height if x == at else x % 7) for x in range(count)]
    shown = thinned(group)
    assert len(shown) <= MOST and set(shown) <= set(group)
    if group:
        assert max(y for _, y in shown) == max(y for _, y in group)
