"""Bugs that show only in rare states of the hardware."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from controller import shutdown
from hal.components.component import Component
from hal.components.component_lifecycle import deactivate_all
from hal.gate import Gated, SafetyGate
from hal.leaps import SeamCrossings
from hal.lifecycle import LifecycleState
from hal.types import FloatArray
from servoloop.stack import control_stack
from tests.servoloop.planted_bugs.registry import detected_by


@detected_by("nan holds")
def gate_limits_infinite_commands(patch: pytest.MonkeyPatch) -> None:
    limit = SafetyGate.limit

    def wrong(gate: SafetyGate, wanted: FloatArray, last: FloatArray, period_s: float, *more: Any) -> Gated:
        finite = np.where(np.isinf(wanted), np.clip(wanted, gate._lower, gate._upper), wanted)
        return limit(gate, finite, last, period_s, *more)

    patch.setattr(SafetyGate, "limit", wrong)


@detected_by("ends as chosen")
def lost_components_are_not_released(patch: pytest.MonkeyPatch) -> None:
    release = shutdown._release

    def wrong(component: Component) -> dict[str, Sequence[str]]:
        return {} if component.state is LifecycleState.UNCONFIGURED else release(component)

    patch.setattr(shutdown, "_release", wrong)


@detected_by("ends as chosen")
def a_second_signal_skips_the_release(patch: pytest.MonkeyPatch) -> None:
    shut_down = shutdown.shut_down

    def wrong(*arguments: Any, hurry: Callable[[], bool], **more: Any) -> list[str]:
        def deactivate(hardware: Any, relax: bool) -> list[str]:
            return [] if hurry() else deactivate_all(hardware, relax)

        with pytest.MonkeyPatch.context() as inner:
            inner.setattr(shutdown, "deactivate_all", deactivate)
            return shut_down(*arguments, hurry=hurry, **more)

    patch.setattr(control_stack, "shut_down", wrong)


@detected_by("taken back", "reported truly")
def joints_that_return_over_their_seam_are_one_turn_off(patch: pytest.MonkeyPatch) -> None:
    counts = SeamCrossings.counts

    def wrong(crossings: SeamCrossings, name: str, reading: int) -> int:
        before = crossings._missing[name]
        found = counts(crossings, name, reading)
        if before and crossings._missing[name] != before:
            crossings._missing[name] -= before
        return found

    patch.setattr(SeamCrossings, "counts", wrong)
