"""Faults that change the bytes of a reply."""

from random import Random

import pytest

from sim_backend.faults.replies import FlippedReplies, LostReplies, Noise, TruncatedReplies


@pytest.mark.parametrize("kind", [FlippedReplies, LostReplies, Noise, TruncatedReplies])
@pytest.mark.parametrize("size", [1, 2, 8])
def test_a_reply_that_another_fault_has_truncated_can_be_changed(kind: type[TruncatedReplies], size: int) -> None:
    fault = kind(chance=1.0, seed=1)
    for seed in range(20):
        fault.spoil(Random(seed), bytes(range(size)))
