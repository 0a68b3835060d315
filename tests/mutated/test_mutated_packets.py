"""Tests that no bytes make a decoder or a virtual servo of any make raise an error."""

import os

import pytest

from tests.mutated.lines import decoders, feed, talk
from tests.mutated.packets import MAKES

pytestmark = pytest.mark.slow

STREAMS = int(os.environ.get("SERVOLOOP_MUTATED_STREAMS", "7000"))
"""Total number of mutated streams for the virtual servos of all makes."""
SEED = int(os.environ.get("SERVOLOOP_MUTATION_SEED", "1"))


@pytest.mark.parametrize("make", MAKES)
def test_no_bytes_end_a_decoder(make: str) -> None:
    for hear in decoders(make).values():
        feed(make, hear, SEED, STREAMS // len(MAKES))


@pytest.mark.parametrize("make", MAKES)
def test_no_bytes_end_virtual_servos(make: str) -> None:
    talk(make, SEED, STREAMS // len(MAKES))
