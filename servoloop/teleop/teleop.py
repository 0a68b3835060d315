"""One teleoperation from start to end: the loop in its thread, the person at the terminal in this one."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from drivers.clock import MonotonicClock, wall_offset_s
from hal.components.component_lifecycle import clean_up_all, configure_all
from hal.lifecycle import LifecycleState
from hal.servos.leader_arm import LEADER
from servoloop.background_worker import BackgroundWorker
from servoloop.line_rate import check_rates
from servoloop.loop_thread import LEFT, LoopThread, run_beside
from servoloop.realtime import claim_realtime_priority
from servoloop.signals import Signals
from servoloop.stack_recording import StackRecording
from servoloop.teleop.arms import Side, Teleop, build_teleop
from servoloop.teleop.dead_man import Permission

AGAIN_S: Final = 1.0
"""So often a lost leader is looked for."""


def teleop(
    leader: Side,
    follower: Side,
    rate_hz: int,
    permission: Permission,
    show: Callable[[Teleop], None],
) -> int:
    """Let the follower follow until a signal, the person's word, or a fault; the exit status.

    ``show`` is called many times a second. The follower ends held or parked, as its robot file says, and the leader
    as it is, limp. Who looks on finds both under the follower's name. Raises as bringing up an arm does, and
    TeleopError.
    """
    files = replace(follower.files, controllers=replace(follower.files.controllers, update_rate_hz=rate_hz))
    clock, worker, recording = MonotonicClock(), BackgroundWorker(), StackRecording(None)
    both = build_teleop(leader, replace(follower, files=files), clock, worker, recording.tap)
    loop, exits = both.loop, files.robot.file.on_exit
    relax = (exits.virtual if both.setup.virtual else exits.real) == "relax"
    with Signals(LEFT) as signals:
        run = LoopThread(loop, worker, relax, files, signals)
        configure_all(loop.hardware)
        try:
            check_rates(both.setup.buses, both.setup.rates_hz, files.robot, files.controllers.path)
            claim_realtime_priority()
            with recording.of(loop, files, wall_offset_s(clock, time.time), lambda: run.failed, both.setup.scene):
                loop.activate(keep_inactive=[LEADER])
                _run(run, both, permission, show)
        finally:
            if not run.hangs():
                clean_up_all(loop.hardware)
    return 1 if run.failed or both.lost else 0


def _run(run: LoopThread, both: Teleop, permission: Permission, show: Callable[[Teleop], None]) -> None:
    """The loop runs in its thread until this one says that it is enough."""
    looked_s = 0.0

    def look() -> None:
        nonlocal looked_s
        now_s = time.monotonic()
        both.controller.allowed = permission.allowed(now_s)
        if permission.ended() or both.lost:
            run.signals.ask()
        if both.leader.error is not None and now_s - looked_s > AGAIN_S:
            looked_s = now_s
            both.loop.component_transitions.ask(LEADER, LifecycleState.INACTIVE)
        show(both)

    try:
        run_beside(run, look)
    finally:
        both.controller.allowed = False
