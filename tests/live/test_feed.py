"""The live feed: viewers receive the messages of a recording, and slow viewers do not delay the other programs."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from servoloop.recording import feed
from servoloop.recording.bus_tap import Transfer
from servoloop.recording.stack_recording import StackRecording
from servoloop.recording.stream import (
    FOLDER,
    LiveError,
    RunningStack,
    find_stack,
    live_folder,
    make_live_folder,
    open_live,
    running_stacks,
    socket_path,
)
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.shipped_files import ARMS, URDF
from tests.live.rig import LiveRig, LiveViewer, runtime_folder
from tests.recorder.rig import Rig
from tests.stack.rig import READY


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with runtime_folder(monkeypatch):
        yield


def test_viewer_receives_every_cycle_after_connecting() -> None:
    rig = LiveRig()
    rig.play(0.5)
    assert not rig.feed.eager
    viewer = LiveViewer(open_live(find_stack()))
    goal = rig.stack.go([*READY[:5], READY[5] + 0.2], 1.0)
    cycles = rig.play(1.5)
    assert rig.feed.eager and goal.done
    rig.feed.close((), failed=False)
    state = viewer.to_its_end()
    now, last = state.snapshot, rig.samples[-1]
    assert now.joints == tuple(rig.stack.loop.hardware.joints)
    np.testing.assert_array_equal(now.position, last.state.position)
    assert now.stamp_s == pytest.approx(last.state.stamp_s) and now.lost_cycles == 0
    curves = state.curves()
    assert len(curves.time_s) == cycles and curves.position.shape == (cycles, len(now.joints))
    np.testing.assert_array_equal(curves.command[-1][: len(last.command)], last.command)
    assert now.description_xml == rig.stack.files.description.xml
    ended = "succeeded Goal successfully reached!"
    assert now.goals["arm_controller"].ended == ended and now.results[-1][1] == f"arm_controller: {ended}"
    np.testing.assert_allclose(now.goals["arm_controller"].positions, [[*READY[:5], READY[5] + 0.2]])
    assert now.statuses["servoloop: control loop"].level == 0 and now.cycles > cycles
    assert float(now.statuses["servoloop: joint1 (servo 1)"].values["voltage_v"]) > 5.0


def test_new_viewer_receives_the_running_goal() -> None:
    rig = LiveRig()
    rig.stack.go([*READY[:5], READY[5] + 0.2], 1.0)
    rig.play(0.5)
    viewer = LiveViewer(open_live(find_stack()))
    rig.play(0.1)
    rig.feed.close((), failed=False)
    assert viewer.to_its_end().snapshot.goals["arm_controller"].ended == ""


def test_new_viewer_receives_the_result_of_the_last_goal() -> None:
    """Without the result, the viewer would show the goal as running forever."""
    rig = LiveRig()
    for joint6 in (0.2, 0.4):
        rig.stack.go([*READY[:5], READY[5] + joint6], 0.5)
        rig.play(1.5)
    viewer = LiveViewer(open_live(find_stack()))
    rig.play(0.1)
    rig.stack.go([*READY[:5], READY[5]], 1.0)
    rig.play(0.1)
    late = LiveViewer(open_live(find_stack()))
    rig.play(0.1)
    rig.feed.close((), failed=False)
    snapshot = viewer.to_its_end().snapshot
    ((_, text),) = snapshot.results
    assert text == "arm_controller: succeeded Goal successfully reached!"
    goal = late.to_its_end().snapshot.goals["arm_controller"]
    assert goal.ended == "" and goal.positions[0][5] == READY[5], "the result was of the goal before"


def test_bytes_after_the_last_cycle_are_sent() -> None:
    rig = LiveRig()
    stream = open_live(find_stack())
    rig.play(0.2)
    rig.feed.close([Transfer(9.0, "bus", True, b"last")], failed=False)
    *_, (_, channel, last) = stream.encoded()
    assert channel.topic == "/servoloop/bus_traffic" and b"last" in last.data


def test_slow_viewer_loses_whole_cycles_and_can_count_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed, "MAX_QUEUE_BYTES", 20_000)
    rig = LiveRig()
    stream = open_live(find_stack())
    cycles = rig.play(20.0)  # more cycles than the socket can buffer
    viewer = LiveViewer(stream)
    for _ in range(4):  # Each of these cycles is read, because only a later message reports lost cycles.
        rig.wait_until_read()
        cycles += rig.play(0.05)
    rig.feed.close((), failed=False)
    state = viewer.to_its_end()
    seen = len(state.curves().time_s)
    assert 4 <= seen < cycles and state.snapshot.lost_cycles == cycles - seen


def test_disconnected_viewer_is_removed_and_others_continue() -> None:
    rig = LiveRig()
    gone, there = socket.socket(socket.AF_UNIX), LiveViewer(open_live(find_stack()))
    gone.connect(str(find_stack().socket))
    rig.play(0.2)
    gone.close()
    cycles = rig.play(0.5)
    assert len(rig.feed._viewers) == 1
    rig.feed.close((), failed=False)
    assert len(there.to_its_end().curves().time_s) >= cycles


def test_stream_can_be_closed_from_another_thread() -> None:
    rig = LiveRig()
    stream = open_live(find_stack())
    viewer = LiveViewer(stream)
    rig.play(0.2)
    stream.close()
    viewer.to_its_end()


def test_stacks_are_found_by_arm_and_dead_sockets_are_removed() -> None:
    with pytest.raises(LiveError, match="no stack is running: start one with"):
        find_stack()
    make_live_folder()
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(str(socket_path("koch", 7)))
    one, other = LiveRig("so101", 11), LiveRig("robot_arm", 12)
    found = [RunningStack("robot_arm", 12, socket_path("robot_arm", 12)), find_stack("so101")]
    assert running_stacks() == found and not socket_path("koch", 7).exists()
    with pytest.raises(LiveError, match=r"several stacks are running: robot_arm \(process 12\), so101 \(process 11\)"):
        find_stack()
    with pytest.raises(LiveError, match=r"no stack of koch is running\. Running stacks: robot_arm"):
        find_stack("koch")
    one.feed.close((), failed=False)
    assert find_stack() == found[0]
    other.feed.close((), failed=False)
    assert not list(live_folder().iterdir())
    with pytest.raises(LiveError, match="has just stopped"):
        open_live(found[0])


def test_arms_with_equal_names_are_distinguished_by_folder(tmp_path: Path) -> None:
    folders = [tmp_path / "left" / "so101", tmp_path / "right" / "so101"]
    for folder in folders:
        folder.mkdir(parents=True)
    rigs = [LiveRig("so101", pid, folder) for pid, folder in enumerate(folders, 1)]
    with pytest.raises(LiveError, match=rf"several stacks .*so101 \(process 1, {folders[0]}\).* folder or process ID"):
        find_stack("so101")
    for pid, folder in enumerate(folders, 1):
        found = find_stack(str(folder))
        assert (found.pid, found.folder) == (pid, folder)
    with pytest.raises(LiveError, match=r"no stack of \./so101 is running"):
        find_stack("./so101")
    assert find_stack("2").pid == 2
    for rig in rigs:
        rig.feed.close((), failed=False)
    assert not list(live_folder().iterdir())


@pytest.mark.parametrize("namespace", ["/left", "/lab_1/left"])
def test_stacks_are_found_by_their_namespaces(namespace: str) -> None:
    make_live_folder()
    with socket.socket(socket.AF_UNIX) as server, socket.socket(socket.AF_UNIX) as other:
        server.bind(str(socket_path("so.101", 3, namespace)))
        other.bind(str(socket_path("so.101", 4)))
        server.listen()
        other.listen()
        assert [(one.arm, one.namespace, one.pid) for one in running_stacks()] == [
            ("so.101", namespace, 3),
            ("so.101", "", 4),
        ]
        assert find_stack(namespace=namespace).pid == find_stack("so.101", namespace).pid == find_stack("3").pid == 3
        assert find_stack("so.101", "").pid == 4
        with pytest.raises(LiveError, match=rf"several .*: so.101 in {namespace} \(process 3\).*or --namespace"):
            find_stack()
        with pytest.raises(LiveError, match="no stack in the namespace /right is running"):
            find_stack(namespace="/right")
    for path in live_folder().iterdir():
        path.unlink()


def test_folder_link_of_a_killed_stack_is_removed() -> None:
    make_live_folder()
    socket_path("koch", 7).with_suffix(FOLDER).symlink_to("/nowhere")
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(str(socket_path("koch", 7)))
    assert running_stacks() == [] and not list(live_folder().iterdir())


def test_stack_publishes_the_folder_of_its_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The arm of a user may have the name of an included arm, but it has its own folder."""
    own = tmp_path / "robot_arm"
    own.mkdir()
    (own / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'robot_arm'}\n")
    monkeypatch.chdir(tmp_path)
    files, rig = read_arm_files(find_arm("./robot_arm")), Rig()
    with StackRecording(None).of(rig.stack.loop, files, 0.0, lambda: False):
        found = find_stack("robot_arm")
        assert found.folder == own and find_stack("./robot_arm") == found
    assert read_arm_files(find_arm(), urdf=URDF).folder == find_arm().folder, "the arm's own URDF"
    (copy := tmp_path / "copy.urdf").write_text(URDF.read_text())
    described = read_arm_files(find_arm(), urdf=copy)
    assert described.folder == tmp_path, "files that belong to no arm have the poses of no arm"


def test_starting_stack_is_not_mistaken_for_a_dead_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Slow(socket.socket):
        """Socket that is probed after it is bound but before it listens."""

        def listen(self, backlog: int = 0) -> None:
            assert running_stacks() == []
            super().listen(backlog)

    monkeypatch.setattr("servoloop.recording.feed.socket.socket", Slow)
    rig = LiveRig()
    assert [stack.pid for stack in running_stacks()] == [1]
    rig.feed.close((), failed=False)


def test_live_folder_is_private_to_its_user() -> None:
    make_live_folder()
    assert os.stat(live_folder()).st_mode & 0o777 == 0o700
    live_folder().chmod(0o755)
    with pytest.raises(LiveError, match="another user owns or can read"):
        make_live_folder()


def test_socket_of_a_paused_stack_stays_while_many_programs_look_for_it() -> None:
    """The connections of these clients are not accepted, because no cycle runs."""
    rig = LiveRig()
    for _ in range(30):
        assert len(running_stacks()) == 1
    rig.feed.close((), failed=False)
