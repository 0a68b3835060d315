"""The pick-and-place job from the controllers to the cube, in simulated time."""

from pathlib import Path

import pytest

from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import Files, read_files
from servoloop.stack.shipped_files import CONFIG, URDF
from tests.stack.rig import BINS, UnpacedJob

LARGEST_RAD, RMS_RAD = 0.08, 0.03


@pytest.mark.parametrize("grade", BINS)
def test_client_without_pauses_for_the_hand_sorts_its_cube(grade: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    rig = SimulatedStack().up()
    job = UnpacedJob(rig, grade)
    job.run()
    rig.run(1.0)
    job.check()
    assert rig.loop.figures.missed == 0
    assert "safety gate" not in caplog.text
    largest, rms = rig.trace.following_error()
    assert largest.max() < LARGEST_RAD
    assert rms.max() < RMS_RAD


@pytest.mark.slow
def test_consecutive_jobs_without_restart() -> None:
    rig = SimulatedStack().up()
    ended: list[str | None] = []
    for grade in "CAB":
        UnpacedJob(rig, grade).run()
        rig.run(1.5)
        ended.append(rig.world.cube_bin())
    assert ended == ["C", "A", "B"]


def test_arm_goals_end_before_their_client_times_out() -> None:
    """The node waits ten seconds for a goal; MoveIt waits for its duration plus a margin."""
    rig = SimulatedStack().up()
    job = UnpacedJob(rig, "A")
    sent_s: list[float] = []
    took_s: list[float] = []

    def react() -> None:
        job.react()
        while len(sent_s) < len(job.handles):
            sent_s.append(rig.clock.now())
        while len(took_s) < sum(handle.done for handle in job.handles):
            took_s.append(rig.clock.now() - sent_s[len(took_s)])

    rig.after_cycle = react
    rig.run(20.0, lambda: len(took_s) == 4)
    assert len(took_s) == 4
    assert max(took_s) < 1.1 * 2.0 + 1.5


def test_equal_runs_give_equal_bytes() -> None:
    def run() -> tuple[object, ...]:
        rig = SimulatedStack().up()
        rig.bus.faults.corrupt_next(3)
        UnpacedJob(rig, "B").run(4.0)
        rig.bus.faults.silence(5)
        rig.run(0.5)
        return rig.port.sent, rig.port.received, rig.world.position().tolist(), rig.loop.figures

    assert run() == run()


def _files(folder: Path, *, robot: tuple[str, str] = ("", ""), urdf: tuple[str, str] = ("", "")) -> Files:
    """Return the default arm with changes to its robot file or its URDF."""
    made = {}
    for path, (old, new) in ((CONFIG / "robot_arm.yaml", robot), (URDF, urdf)):
        text = path.read_text()
        assert old in text
        made[path.suffix] = folder / path.name
        made[path.suffix].write_text(text.replace(old, new))
    return read_files(made[".urdf"], robot=made[".yaml"])


def test_job_succeeds_with_spline_interpolation(tmp_path: Path, grade: str = "B") -> None:
    """With splines, a goal without velocities becomes a linear motion, with velocity steps at its ends."""
    rig = SimulatedStack(
        files=_files(tmp_path, robot=("interpolation_method: ruckig", "interpolation_method: splines"))
    ).up()
    job = UnpacedJob(rig, grade)
    job.run()
    rig.run(1.0)
    job.check()


@pytest.mark.parametrize("grade", ["C"])
def test_job_waits_for_a_slow_hand(tmp_path: Path, grade: str) -> None:
    rig = SimulatedStack(
        files=_files(tmp_path, urdf=('effort="40" velocity="0.09"', 'effort="40" velocity="0.018"'))
    ).up()
    job = UnpacedJob(rig, grade)
    job.run(40.0)
    rig.run(1.0)
    job.check()
