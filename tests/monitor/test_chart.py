"""Plots in the terminal: all points are drawn and joined, except at NaN."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from servoloop.dashboard.terminal_chart import BLANK, COLUMNS, ROWS, chart

WIDTH, HEIGHT = 10, 4
X, Y = (-60.0, 0.0), (-1.0, 1.0)


def dots(characters: np.ndarray) -> np.ndarray:
    """Return the dots (rows, columns) of braille characters, by the dot numbers in Unicode."""
    numbers = [[1, 4], [2, 5], [3, 6], [7, 8]]
    found = np.zeros((characters.shape[0] * ROWS, characters.shape[1] * COLUMNS), bool)
    for (line, place), character in np.ndenumerate(characters):
        for row in range(ROWS):
            for column in range(COLUMNS):
                bit = 1 << numbers[row][column] - 1
                found[line * ROWS + row, place * COLUMNS + column] = bool(character - BLANK & bit)
    return found


def drawn(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return dots(chart(x, y, X, Y, WIDTH, HEIGHT))


@given(arrays(float, 12, elements=st.floats(-1.0, 1.0)))
def test_every_point_has_its_dot_and_neighbors_are_joined(y: np.ndarray) -> None:
    x = np.linspace(*X, 12)
    found = drawn(x, y)
    row = np.rint((1.0 - y) / 2.0 * (HEIGHT * ROWS - 1)).astype(int)
    column = np.rint((x + 60.0) / 60.0 * (WIDTH * COLUMNS - 1)).astype(int)
    expected = (HEIGHT * ROWS - 1) - (y + 1.0) / 2.0 * (HEIGHT * ROWS - 1)
    clear = np.abs(expected - np.floor(expected) - 0.5) > 1e-6  # not between two dots
    assert found[row[clear], column[clear]].all()
    assert found.any(axis=0).all(), "a line from end to end has a dot in each column"


def test_a_step_is_a_vertical_line_and_a_gap_stays_empty() -> None:
    found = drawn(np.array([-60.0, -30.0, -30.0, 0.0]), np.array([-1.0, -1.0, 1.0, 1.0]))
    assert found[-1, :10].all() and found[0, 10:].all() and found[:, 10].all()
    found = drawn(np.array([-60.0, -40.0, -20.0, 0.0]), np.array([0.0, np.nan, 0.0, 0.0]))
    assert found[:, 0].any() and not found[:, 1:12].any() and found[:, 13:].any(axis=0).all()


def test_no_points_and_points_outside_leave_the_chart_blank() -> None:
    nothing = np.empty(0)
    assert not drawn(nothing, nothing).any()
    assert not drawn(np.array([-70.0, 10.0]), np.array([5.0, 5.0])).any()
    assert not drawn(np.array([-1.0]), np.array([np.nan])).any()
