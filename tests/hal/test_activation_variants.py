"""Tests of the activation with all known firmware variants: nothing moves, even on bad buses and with stale goals."""

from itertools import product

import pytest

from drivers.driver_errors import DriverError
from drivers.servos import sts
from hal.hal_errors import ActivationError
from sim_backend.faults import Disturbance
from sim_backend.servos.sts.firmware import StsVariant
from tests.hal.bench import IDS, Bench

VARIANTS = [StsVariant(*choices) for choices in product((True, False), repeat=3)]
"""Each variant combines three behaviors: whether a goal enables torque, whether torque uses a stale goal, and whether
the next write discards a stale goal."""
STALE = (0, 3000, 2048)
LOSSES = [None, *(Disturbance(seed, drop=0.1, flip=0.05, noise=0.05, miss=0.1) for seed in range(6))]


@pytest.mark.parametrize("losses", LOSSES, ids=lambda losses: "all well" if losses is None else f"seed {losses.seed}")
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: f"{v.goal_write_energises:d}{v.torque_on_takes_goal:d}")
def test_no_joint_moves_during_activation(variant: StsVariant, losses: Disturbance | None) -> None:
    bench = Bench(variant=variant)
    for servo, goal in zip(bench.servos.servos, STALE, strict=True):
        servo.memory.put(sts.goal_position, goal)  # set directly, because a write would enable torque
    bench.configured()
    before = [bench.measured(i) for i in IDS]
    if losses is not None:
        bench.servos.faults.disturbance = Disturbance(losses.seed, losses.drop, losses.flip, losses.noise, losses.miss)
    try:
        bench.hardware.activate()
    except (ActivationError, DriverError):
        assert losses is not None
    else:
        assert bench.torque() == list(IDS)
    for _ in range(20):  # observe for some cycles, whatever the result was
        bench.clock.sleep_until(bench.clock.now() + 0.02)
        bench.servos.advance(bench.clock.now())
        assert all(abs(bench.measured(i) - at) <= 1 for i, at in zip(IDS, before, strict=True))
