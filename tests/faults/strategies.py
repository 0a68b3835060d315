"""A hypothesis strategy for any fault."""

from random import Random
from typing import Final

from hypothesis import strategies as st

from drivers.servos import sts, x
from sim_backend.faults.event import Event
from sim_backend.faults.events import KINDS
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.lines import AdapterUnplugged
from sim_backend.faults.targets import Inventory, Since

TWO_LINES: Final = Inventory(
    {"arm": dict.fromkeys(range(1, 7), sts.STS3215), "the hand": dict.fromkeys((1, 7), x.XL430_W250)}
)


def _event(kind: str, seed: int, at_s: float, for_s: float, since: Since) -> Event:
    random = Random(seed)
    while True:
        try:
            event = KINDS[kind].drawn(random, TWO_LINES, at_s, since)
        except FaultError:
            continue
        lasts = event.for_s is not None and not isinstance(event, AdapterUnplugged)
        return event.model_copy(update={"for_s": for_s}) if lasts else event


def events() -> st.SearchStrategy[Event]:
    times = st.floats(1e-6, 1e6)
    moments = st.sampled_from(TWO_LINES.moments)
    return st.builds(_event, st.sampled_from(sorted(KINDS)), st.integers(0, 1 << 32), times, times, moments)
