"""Which worker gets which files: tests in real time mostly wait and must not be kept waiting, the others compute."""

import os
from typing import Any

import pytest
from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController

IN_REAL_TIME = (
    *("tests/ros/", "tests/peers/", "tests/launch/", "tests/bench/"),
    *("tests/commissioning/test_calibrate_cli", "tests/commissioning/test_doctor_verb"),
    *("tests/commissioning/test_ports", "tests/commissioning/test_tune_real_time", "tests/commissioning/test_verbs"),
    *("tests/drivers/test_add_a_servo", "tests/drivers/test_port_contract", "tests/drivers/test_serial_port"),
    *("tests/servoloop/test_setup_verb", "tests/servoloop/test_signals", "tests/sim_backend/test_emulator_pty"),
    *("tests/bench_arm/test_verb", "tests/monitor/test_docs", "tests/teach/test_docs", "tests/testing/test_docs"),
    *("tests/faults/test_docs", "tests/handling/test_handling_over_ros", "tests/live/test_record_verb"),
    *("tests/commissioning/test_set_up_read_by_others", "tests/servoloop/test_passport_verb", "tests/teleop/test_docs"),
    *("tests/view/test_first_page", "tests/view/test_move_in_chromium", "tests/view/test_page_in_chromium"),
)
"""Programs with time limits of their own talk to each other here, over ROS or a pseudo-terminal."""


def in_real_time(nodeid: str) -> bool:
    """Whether a test or its file is one of these."""
    return nodeid.startswith(IN_REAL_TIME)


def stand_back() -> None:
    """Leave the processor to whoever works in real time, for the rest of this process' life."""
    os.setpriority(os.PRIO_PROCESS, 0, 10)


class ComputingAside(LoadFileScheduling):
    """Files in order, but one worker computes from the beginning and leaves those in real time to the others.

    So the time in which stacks wait is used, and there is always one stack fewer than there are workers. A worker that
    has begun to compute stands back (tests/conftest.py), and is given nothing in real time any more: where the tests
    are the slow ones, which load the machine most, another one has waited to take its place.
    """

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        self._computing: WorkerController | None = None
        self._substitute: WorkerController | None = None
        """Has no work until the computing is done."""

    def _choose(self) -> None:
        """Choose the worker that computes, and the one that takes its place."""
        self._computing = self.nodes[-1]
        slow = "slow" in self.config.option.markexpr.split(" or ")
        if slow and len(self.nodes) > 2 and self._next_to_compute() is not None:
            self._substitute = self.nodes[-2]

    def _assign_work_unit(self, node: WorkerController) -> None:
        if self._computing is None:
            self._choose()
        if node is self._substitute:
            return
        if node is self._computing and len(self.nodes) > 1 and (computing := self._next_to_compute()) is not None:
            self.workqueue.move_to_end(computing, last=False)
        super()._assign_work_unit(node)

    def _reschedule(self, node: WorkerController) -> None:
        if node is self._substitute:
            return
        stands_back = len(self.nodes) > 1 and any(not in_real_time(file) for file in self.assigned_work[node])
        if stands_back and self.workqueue and self._next_to_compute() is None and not node.shutting_down:
            node.shutdown()
        super()._reschedule(node)
        computed = node is self._computing and node.shutting_down and not self._pending_of(self.assigned_work[node])
        if computed or not self.workqueue:
            self._let_in()

    def _let_in(self) -> None:
        """Give the one that has waited its first work, two files as to all; or end it where there is none."""
        if self._substitute is not None:
            substitute, self._substitute = self._substitute, None
            self._reschedule(substitute)
            self._reschedule(substitute)

    def _next_to_compute(self) -> str | None:
        return next((file for file in self.workqueue if not in_real_time(file)), None)
