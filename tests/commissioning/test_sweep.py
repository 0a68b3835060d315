"""Property of the sweep of one joint: its travel does not depend on the encoder's seam."""

from hypothesis import given
from hypothesis import strategies as st

from commissioning.calibrate.sweep import Swept
from drivers.servos.angles import TURN


@given(st.integers(0, TURN - 1), st.integers(0, TURN - 2), st.integers(1, TURN // 2 - 1), st.data())
def test_a_sweep_gives_its_range_wherever_the_wrap_is(lower: int, span: int, step: int, data: st.DataObject) -> None:
    path = [data.draw(st.integers(0, span))]
    for target in (path[0], span, 0, data.draw(st.integers(0, span))):
        while path[-1] != target:
            path.append(path[-1] + max(-step, min(step, target - path[-1])))
    # Each position is read twice, because a single reading may be wrong and is not used.
    first, *readings = [(lower + at) % TURN for at in path for _ in range(2)]
    swept = Swept(first, first, first)
    for reading in (*readings, readings[-1]):
        swept.take(reading, TURN)
    assert swept.travel.span == span
    assert swept.travel.lower % TURN == lower
