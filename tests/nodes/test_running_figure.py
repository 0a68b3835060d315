"""Running figures of the introspection topics."""

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("pal_statistics_msgs")

from hypothesis import given
from hypothesis import strategies as st

from nodes.manager.introspection import RunningFigure


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50))
def test_figures_are_those_of_all_values(values: list[float]) -> None:
    figure = RunningFigure()
    for value in values:
        figure.add(value)
    expected = (max(values), min(values), np.mean(values), np.std(values), len(values))
    assert figure.parts == pytest.approx(expected, rel=1e-6, abs=1e-3)
