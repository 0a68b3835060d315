"""Distribute test files to workers, so that real-time tests, which mostly wait, are not delayed by tests that
compute."""

import os
from collections import OrderedDict
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
    *("tests/api/test_arm_servos", "tests/examples/", "tests/integrations/lerobot/test_lerobot_commands"),
    *("tests/faults/test_docs", "tests/handling/test_handling_over_ros", "tests/live/test_record_verb"),
    *("tests/commissioning/test_unknown_models", "tests/commissioning/test_answers_no_reads"),
    *("tests/command_socket/test_bad_clients", "tests/command_socket/test_commands", "tests/monitor/test_app"),
    *("tests/handling/test_robot_client", "tests/view/test_mover_without_browser"),
    "tests/docs/test_every_block_is_run",  # reads the markers of all these files
    *("tests/commissioning/test_set_up_read_by_others", "tests/servoloop/test_passport_verb", "tests/teleop/test_docs"),
    *("tests/servoloop/test_up_without_ros", "tests/command_socket/test_up_and_clients", "tests/api/test_arm_socket"),
    "tests/perception/test_sources",
    *("tests/view/test_first_page", "tests/view/test_move_in_chromium", "tests/view/test_page_in_chromium"),
)
"""Files whose programs communicate with time limits, over ROS or a pseudo-terminal."""


def in_real_time(nodeid: str) -> bool:
    """Return whether a test or file belongs to ``IN_REAL_TIME``."""
    return nodeid.startswith(IN_REAL_TIME)


def stand_back() -> None:
    """Lower the priority of this process until its end, in favor of real-time tests in other processes."""
    os.setpriority(os.PRIO_PROCESS, 0, max(10, os.getpriority(os.PRIO_PROCESS, 0)))


class ComputingAside(LoadFileScheduling):
    """Distribute files in order, but let one worker compute from the start and leave real-time tests to the other
    workers.

    This uses the time in which stacks wait, and the number of stacks is always one less than the number of workers. A
    worker that has begun to compute has a lower priority (tests/conftest.py) and gets no more real-time tests.
    """

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        self._computing: WorkerController | None = None
        self._deadly: set[str] = set()

    def schedule(self) -> None:
        """Assign files, and assign work twice if a worker starts late.

        A worker keeps its last test until it gets a further test. xdist would assign only one file, so that a file with
        a single test would never be completed.
        """
        if self.collection is not None:
            super().schedule()
        super().schedule()

    def remove_node(self, node: WorkerController) -> str | None:
        """Reassign the unfinished files of a dead worker, and return the test that was running, if any.

        This test is repeated once, but not again if it ends a second worker. xdist would also reassign finished files,
        and a worker that gets such a file would wait forever.
        """
        left = {file: tests for file, tests in self.assigned_work.pop(node).items() if not all(tests.values())}
        deadly = next((test for tests in left.values() for test, done in tests.items() if not done), None)
        if deadly in self._deadly:
            file = self._split_scope(deadly)
            left[file][deadly] = True
            if all(left[file].values()):
                del left[file]
        elif deadly is not None:
            self._deadly.add(deadly)
        if node is self._computing:
            self._computing = None
        waiting = {**left, **self.workqueue}
        self.workqueue = OrderedDict(sorted(waiting.items(), key=lambda one: not in_real_time(one[0])))
        for other in self.nodes:
            self._reschedule(other)
        return deadly

    def mark_test_pending(self, item: str) -> None:  # type: ignore[override]
        """Do nothing, because ``remove_node`` has already reassigned the test."""

    def _assign_work_unit(self, node: WorkerController) -> None:
        self._computing = self._computing or self.nodes[-1]
        if node is self._computing and len(self.nodes) > 1 and (computing := self._next_to_compute()) is not None:
            self.workqueue.move_to_end(computing, last=False)
        super()._assign_work_unit(node)

    def _reschedule(self, node: WorkerController) -> None:
        stands_back = len(self.nodes) > 1 and any(not in_real_time(file) for file in self.assigned_work[node])
        if stands_back and self.workqueue and self._next_to_compute() is None and not node.shutting_down:
            node.shutdown()
        super()._reschedule(node)

    def _next_to_compute(self) -> str | None:
        return next((file for file in self.workqueue if not in_real_time(file)), None)
