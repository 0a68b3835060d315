"""Recordings of other programs and damaged recordings: joints are matched by name, and intact data is used."""

import logging
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from typer.testing import CliRunner

from servoloop.cli import app
from servoloop.recording.mcap import RecordingError
from servoloop.recording.reader import read_recording
from servoloop.recording.sources import PlayedRecording
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.teach.motion_files import TeachError
from servoloop.teach.recorded import recorded_motion
from tests.recorder.foreign import State, encoded, swing, write_states
from tests.stack.rig import READY

FILES = read_arm_files(find_arm("robot_arm"))
NAMES = [joint.name for joint in FILES.robot.joints]
LIMITS = [joint.limits for joint in FILES.robot.joints]
REST = dict(zip(NAMES, (*READY, 0.0), strict=True))
ROWS = swing("joint1", {**REST, "joint2": -0.2})


def state(at: float, positions: dict[str, float], names: list[str], **fields: object) -> State:
    return State(at, tuple(names), tuple(positions[name] for name in names), **fields)  # type: ignore[arg-type]


def moved(path: Path, followers: tuple[str, ...] = ()) -> dict[str, float]:
    """Return the travel of each joint when the recording is replayed."""
    motion, _ = recorded_motion(path, NAMES, LIMITS, followers)
    return dict(zip(motion.joints, np.ptp(motion.position, axis=0).tolist(), strict=True))


def only_joint1_moves(path: Path, far: float = 0.4) -> bool:
    found = moved(path)
    return found["joint1"] == pytest.approx(far, abs=0.01) and all(found[name] < 0.002 for name in NAMES[1:])


def test_each_message_is_read_by_its_own_joint_names(tmp_path: Path) -> None:
    turned = [NAMES[1], NAMES[0], *NAMES[2:]]
    states = [state(at, row, NAMES if number else turned) for number, (at, row) in enumerate(ROWS)]
    assert only_joint1_moves(write_states(tmp_path / "x.mcap", states))
    mixed = [state(at, row, NAMES[number % 7 :] + NAMES[: number % 7]) for number, (at, row) in enumerate(ROWS)]
    path = write_states(tmp_path / "y.mcap", mixed)
    assert only_joint1_moves(path)
    snapshot = PlayedRecording(path).play_to(10.0).state.snapshot
    assert dict(zip(snapshot.joints, snapshot.position.tolist(), strict=True)) == pytest.approx(ROWS[-1][1])


def test_several_publishers_are_merged_by_name(tmp_path: Path) -> None:
    states = []
    for number, (at, row) in enumerate(ROWS):
        states.append(state(at, row, NAMES[:6]))
        if number % 4 == 0:  # this publisher is slower, and its stamps are slightly older than those of the arm
            states.append(state(at + 0.001, row, NAMES[6:], stamp_s=at - 0.01))
    path = write_states(tmp_path / "x.mcap", states)
    assert only_joint1_moves(path)
    run = read_recording(path)
    assert run.joints == tuple(NAMES) and np.all(np.diff(run.time_s) > 0.0)
    assert np.isfinite(run.position[1:]).all()
    recording = PlayedRecording(path)
    assert recording.play_to(2.0).state.snapshot.joints == tuple(NAMES)
    assert np.isfinite(recording.robot.state.snapshot.position).all()


def test_joint_of_a_slow_publisher_is_interpolated(tmp_path: Path) -> None:
    states = []
    for number, (at, row) in enumerate(ROWS):
        states.append(state(at, row, NAMES[1:]))
        if number % 4 == 0:
            states.append(state(at, row, NAMES[:1]))
    run = read_recording(write_states(tmp_path / "x.mcap", states))
    wanted = [row["joint1"] for _, row in ROWS]
    assert len(run.time_s) == len(ROWS)
    np.testing.assert_allclose(run.position[:77, run.joints.index("joint1")], wanted[:77], atol=0.005)


def test_mimic_and_unknown_joints_are_ignored(tmp_path: Path) -> None:
    names = [*NAMES, "hand_left_joint", "camera_pan"]
    rows = [(at, {**row, "hand_left_joint": 0.0, "camera_pan": 0.1 * at}) for at, row in ROWS]
    path = write_states(tmp_path / "x.mcap", [state(at, row, names) for at, row in rows])
    _, warnings = recorded_motion(path, NAMES, LIMITS, ["hand_left_joint"])
    assert warnings == ["x.mcap: camera_pan is ignored because the arm has no such joint"]
    assert only_joint1_moves(path)
    some = write_states(tmp_path / "y.mcap", [state(at, row, NAMES[:5]) for at, row in ROWS])
    with pytest.raises(TeachError, match=r"it has no joint6, "):
        recorded_motion(some, NAMES, LIMITS)


def test_command_ignores_mimic_joints_of_the_arm(tmp_path: Path) -> None:
    names = [*NAMES, "hand_left_joint"]
    states = [state(at, {**row, "hand_left_joint": 0.0}, names) for at, row in ROWS]
    path = write_states(tmp_path / "x.mcap", states)
    done = CliRunner().invoke(app, ["replay", str(path), "--port", "./no_such_port", "--hands-free"])
    assert "no_such_port" in str(done.exception) and "hand_left_joint" not in done.output


@pytest.mark.parametrize("fields", [{}, {"velocity": (0.0,)}, {"effort": (1.0, 2.0)}])
def test_fields_may_be_empty_or_short(tmp_path: Path, fields: dict[str, object]) -> None:
    path = write_states(tmp_path / "x.mcap", [state(at, row, NAMES, **fields) for at, row in ROWS])
    assert CliRunner().invoke(app, ["plot", str(path)]).exit_code == 0
    assert only_joint1_moves(path)
    assert PlayedRecording(path).play_to(1.0).state.snapshot.effort.shape == (7,)


def test_positions_may_be_fewer_than_names_or_not_finite(tmp_path: Path) -> None:
    states = [state(at, row, NAMES) for at, row in ROWS]
    states[5] = states[5]._replace(position=states[5].position[:3])
    states[6] = states[6]._replace(position=())
    states[7] = states[7]._replace(position=(float("nan"), float("inf"), *states[7].position[2:]))
    path = write_states(tmp_path / "x.mcap", states)
    assert CliRunner().invoke(app, ["plot", str(path)]).exit_code == 0
    assert only_joint1_moves(path)
    assert np.isfinite(PlayedRecording(path).play_to(0.5).state.snapshot.position).all()


@pytest.mark.parametrize("stamps", ["zero", "constant", "set back"])
def test_log_times_replace_invalid_stamps(tmp_path: Path, stamps: str) -> None:
    chosen = {"zero": lambda n: 0.0, "constant": lambda n: 5.0, "set back": lambda n: 50.0 - n if n > 40 else 20.0 + n}
    states = [state(at, row, NAMES, stamp_s=chosen[stamps](number)) for number, (at, row) in enumerate(ROWS)]
    path = write_states(tmp_path / "x.mcap", states)
    assert only_joint1_moves(path)
    assert read_recording(path).time_s[-1] == pytest.approx(3.95)
    recording = PlayedRecording(path)
    assert recording.length_s == pytest.approx(3.95)
    assert recording.play_to(3.0).state.snapshot.stamp_s == pytest.approx(1003.0)


def in_a_chunk(path: Path) -> int:
    """Return the offset of a byte in the middle of the data of the third chunk."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[2]
    return chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size // 2


@pytest.mark.parametrize("compression", list(CompressionType))
def test_flipped_bit_ends_the_recording_with_a_warning(
    tmp_path: Path, compression: CompressionType, caplog: pytest.LogCaptureFixture
) -> None:
    path = write_states(tmp_path / "x.mcap", [state(at, row, NAMES) for at, row in ROWS], compression)
    content = bytearray(path.read_bytes())
    content[in_a_chunk(path)] ^= 0x10
    path.write_bytes(content)
    run = read_recording(path)
    assert 0 < len(run.time_s) < len(ROWS)
    np.testing.assert_allclose(run.position[:, 0], [row["joint1"] for _, row in ROWS][: len(run.time_s)], atol=1e-9)
    assert f"{path} is damaged; only the part before the damage is used" in caplog.text
    assert CliRunner().invoke(app, ["plot", str(path)]).exit_code == 0
    assert PlayedRecording(path).length_s == pytest.approx(run.time_s[-1])


@pytest.mark.parametrize("crcs", [True, False])
def test_flipped_bits_never_cause_a_traceback(tmp_path: Path, crcs: bool, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    path = write_states(
        tmp_path / "x.mcap", [state(at, row, NAMES) for at, row in ROWS[:20]], CompressionType.LZ4, crcs
    )
    whole, random = path.read_bytes(), np.random.default_rng(1)
    for _ in range(300):
        content = bytearray(whole)
        content[int(random.integers(len(content)))] ^= 1 << int(random.integers(8))
        path.write_bytes(content)
        for read in (read_recording, PlayedRecording):
            try:
                read(path)
            except RecordingError as error:
                assert str(path) in str(error)


def test_message_that_does_not_match_its_type_is_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.recorder.foreign.encoded", lambda one: encoded(one)[: -40 if one is states[3] else None])
    states = [state(at, row, NAMES) for at, row in ROWS]
    path = write_states(tmp_path / "x.mcap", states, crcs=False)
    assert len(read_recording(path).time_s) == len(ROWS) - 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is an empty file, not an MCAP recording"),
        (
            "joints: [größe]\n".encode() * 60,
            "is a text file, not an MCAP recording: choose a file written with --record",
        ),
        (b"SQLite format 3\x00\x10\x00", "is a rosbag2 database: convert it with `ros2 bag convert`"),
        (b"#ROSBAG V2.0\n\x00\x01", "is a recording of ROS 1"),
        (b"\x28\xb5\x2f\xfd\x04\x00", "is compressed: decompress it with `zstd -d`"),
        (bytes(range(256)), "is a file of another format, not an MCAP recording"),
    ],
)
def test_other_file_formats_are_named_in_the_error(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    for read in (read_recording, PlayedRecording):
        with pytest.raises(RecordingError) as refused:
            read(path)
        assert str(refused.value).startswith(f"{path} {message}")


def test_folder_instead_of_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="Is a directory"):
        read_recording(tmp_path)


def test_very_long_motion_is_refused_before_processing(tmp_path: Path) -> None:
    states = [state(at * 1e4, row, NAMES) for at, row in ROWS]
    with pytest.raises(TeachError, match=r"x\.mcap would take .* but a motion may take at most 3600 s"):
        recorded_motion(write_states(tmp_path / "x.mcap", states), NAMES, LIMITS)
