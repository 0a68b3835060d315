"""Text and keys of the monitor's screen for a simulated arm."""

from pathlib import Path
from threading import Event

import numpy as np
import pytest
from textual.pilot import Pilot

from servoloop.dashboard.terminal import JointsTable, MonitorApp
from servoloop.dashboard.terminal_chart import AXIS, BLANK
from servoloop.recording import sources as live_source
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sources import SPEEDS, LiveSource, Playback, PlayedRecording
from sim_backend.clock import SimulatedClock
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.targets import FaultTargets
from sim_backend.faults.text import parse
from tests.live.rig import LiveRig, runtime_folder
from tests.monitor.rig import FixedSource, on_screen, words
from tests.recorder.rig import Rig
from tests.servoloop.served import eventually
from tests.view.rig import moved_rig, watched


@pytest.fixture(scope="module")
def rig() -> Rig:
    return moved_rig()


@pytest.fixture(scope="module")
def seen(rig: Rig) -> ObservedRobot:
    return watched(rig)


def line_of(text: str, word: str) -> str:
    return next(line for line in text.splitlines() if word in line)


def squeezed(text: str) -> str:
    return " ".join(text.split())


def test_the_screen_shows_joints_loop_controllers_goals_and_counters(seen: ObservedRobot) -> None:
    snapshot = seen.state.snapshot

    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        text = words(app)
        assert "robot_arm: live" in text
        degrees = np.degrees(snapshot.position[0])
        assert f"joint1 {degrees:.1f} ° 11.5 ° " in squeezed(line_of(text, "joint1 "))
        assert "27 °C 12.0 V ok" in squeezed(line_of(text, "joint1 "))
        assert f"{1e3 * snapshot.position[6]:.1f} mm" in line_of(text, "hand_right_joint")
        assert squeezed(line_of(text, "duration")).endswith(f"duration {1e3 * snapshot.busy_s:.2f} ms")
        assert squeezed(line_of(text, "missed cycles")).endswith("missed cycles 0")
        assert squeezed(line_of(text, "robot_arm  ")).endswith("robot_arm active")
        assert squeezed(line_of(text, "hand_controller")).endswith("hand_controller active")
        assert "s ago arm_controller: succeeded" in squeezed(line_of(text, " ago"))
        assert squeezed(line_of(text, "(servo 7)")).endswith("none")
        assert "faults" not in text

    on_screen(FixedSource(seen), look)


def test_a_silent_servo_is_named_and_counted() -> None:
    rig = Rig()
    player = FaultPlayer(FaultTargets(rig.stack.lines, rig.stack.world))
    player.play([parse("silent id=3")])
    player.update(rig.stack.clock.now())
    rig.run(1.5)

    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        text = words(app)
        lines = [squeezed(line) for line in text.splitlines() if "joint3" in line]
        assert "joint3 (servo 3) joint3: servo 3 does not respond" in lines[0]
        assert lines[1].endswith("joint3: servo 3 does not respond") and "°C" in lines[1]
        assert "silent " in lines[2]

    on_screen(FixedSource(watched(rig)), look)


def test_keys_select_a_joint_and_its_plots(seen: ObservedRobot) -> None:
    snapshot = seen.state.snapshot

    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        def title(place: int) -> str:
            return f"position, command (rad, m) {snapshot.position[place]:.4g} {snapshot.command[place]:.4g}"

        assert title(0) in squeezed(words(app)) and "temperature (°C)" not in words(app)
        await pilot.press("3")
        assert title(2) in squeezed(words(app))
        await pilot.press("up", "t", "p", "u")
        await pilot.pause()
        text = squeezed(words(app))
        assert "temperature (°C) 27" in text and "voltage (V) 12" in text and "position, command" not in text
        await pilot.press("9", "p")
        await pilot.pause()
        assert title(6) in squeezed(words(app)), "the last joint, because there is no ninth"

    on_screen(FixedSource(seen), look)


def test_the_plots_show_the_last_minute(seen: ObservedRobot) -> None:
    """The latest seconds are on the right, where the position rises; the remaining minute is blank."""

    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        rows = [line[AXIS:] for line in str(app._charts[0].content).splitlines()[1:]]
        width = app._charts[0].size.width - AXIS
        inked = [[column for column, c in enumerate(row) if ord(c) != BLANK] for row in rows]
        assert min(min(row) for row in inked if row) >= width * 0.9
        upper, lower = inked[: len(inked) // 2], inked[len(inked) // 2 :]
        assert max(max(row) for row in upper if row) == width - 1
        assert max(max(row) for row in lower if row) < width - 1

    on_screen(FixedSource(seen), look)


def test_the_state_of_each_joint_is_visible_at_80_columns(seen: ObservedRobot) -> None:
    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        table = app.query_one(JointsTable)
        assert table.virtual_size.width <= 80 and str(list(table.columns.values())[-1].label) == "state"

    on_screen(FixedSource(seen), look, (80, 24))


@pytest.mark.parametrize("size", [(80, 24), (30, 8), (4, 2)])
def test_the_screen_also_works_in_a_small_terminal(seen: ObservedRobot, size: tuple[int, int]) -> None:
    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        await pilot.press("v", "u", "t")
        await pilot.resize_terminal(100, 30)
        await pilot.pause()
        assert "joint6" in words(app)

    on_screen(FixedSource(seen), look, size)


def test_the_screen_is_shown_before_the_first_message() -> None:
    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        await pilot.press("2", "down", "t")
        assert "robot_arm: live" in words(app)

    on_screen(FixedSource(ObservedRobot()), look)


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
def test_a_key_ends_it(seen: ObservedRobot, key: str) -> None:
    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        await pilot.press("space", "left", "plus")
        assert app.is_running, "playback keys have no effect on a running stack"
        await pilot.press(key)
        await pilot.pause()
        assert not app.is_running

    on_screen(FixedSource(seen), look)


def test_a_signal_ends_it(seen: ObservedRobot) -> None:
    signals = Event()

    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        signals.set()
        while app.is_running:
            await pilot.pause(0.01)

    on_screen(FixedSource(seen), look, stop=signals.is_set)


@pytest.mark.slow
def test_a_recording_can_be_played_paused_and_searched(rig: Rig, tmp_path: Path) -> None:
    rig.record(tmp_path / "run.mcap")
    clock = SimulatedClock()
    playback = Playback(PlayedRecording(tmp_path / "run.mcap"), clock)

    async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
        def status(seconds: float) -> str:
            clock.sleep_until(clock.now() + seconds)
            app.show()
            position = np.degrees(playback.robot.state.snapshot.position[0])
            assert f"joint1 {position:.1f} °" in squeezed(line_of(words(app), "joint1 "))
            return squeezed(line_of(words(app), "recording:"))

        length = f"{playback.length_s:.1f} s"
        assert status(0.5) == f"recording: run.mcap, 0.5 of {length}, 1 times the original speed"
        await pilot.press("plus")
        assert status(0.5) == f"recording: run.mcap, 1.5 of {length}, 2 times the original speed"
        await pilot.press("space")
        assert status(9.0) == f"recording: run.mcap, 1.5 of {length}, paused"
        await pilot.press("right")
        assert status(0.0).startswith("recording: run.mcap, 2.5 of")
        assert app._watched is not None
        assert app._watched.state.snapshot.stamp_s == pytest.approx(rig.samples[0].state.stamp_s + 2.5, abs=0.051)
        await pilot.press("left", "left", "left", "left", "space", "minus", "minus")
        assert status(1.0) == f"recording: run.mcap, 0.5 of {length}, 0.5 times the original speed"
        await pilot.press(*["minus"] * 9)
        assert playback.speed == SPEEDS[0]

    on_screen(playback, look)


def test_the_end_of_a_stack_is_reported_and_a_restarted_stack_is_shown_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(live_source, "AGAIN_S", 0.01)

    with runtime_folder(monkeypatch):
        first = LiveRig()
        source = LiveSource(None, SimulatedClock())
        eventually(lambda: first.play(0.05) and source.connected)

        async def look(app: MonitorApp, pilot: Pilot[None]) -> None:
            def says(words_: str) -> bool:
                app.show()
                return words_ in words(app)

            assert says("robot_arm: live") and says("joint6")
            first.feed.close((), failed=False)
            eventually(lambda: says("robot_arm: the stack has stopped. Waiting for it to restart"))
            assert says("joint6"), "the last state stays"
            assert app._status.has_class("unwell")
            again = LiveRig(pid=2)
            eventually(lambda: again.play(0.05) and says("robot_arm: live"))
            assert not app._status.has_class("unwell")
            again.feed.close((), failed=False)

        on_screen(source, look)
        source.close()
