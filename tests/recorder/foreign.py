"""Recordings as other programs write them: MCAP files with ROS 2 messages from any publisher."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys.stores import ros2_jazzy as ros

from servoloop.recording.message_types import JOINT_STATE, definition, typestore


class State(NamedTuple):
    """JointState message. If ``stamp_s`` is None, the stamp equals the log time."""

    log_s: float
    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...] = ()
    effort: tuple[float, ...] = ()
    stamp_s: float | None = None


def write_states(
    path: Path, states: Iterable[State], compression: CompressionType = CompressionType.ZSTD, crcs: bool = True
) -> Path:
    """Write an MCAP file with the ros2 profile that contains these states on the topic /joint_states."""
    with path.open("xb") as stream:
        writer = Writer(stream, 4096, compression, enable_crcs=crcs)
        writer.start(profile="ros2")
        schema = writer.register_schema(JOINT_STATE, "ros2msg", definition(JOINT_STATE).encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for state in states:
            log_ns = round(state.log_s * 1e9)
            writer.add_message(channel, log_ns, encoded(state), log_ns)
        writer.finish()
    return path


def encoded(state: State) -> bytes:
    """Return the message, serialized as CDR."""
    sec, nanosec = divmod(round((state.log_s if state.stamp_s is None else state.stamp_s) * 1e9), 1_000_000_000)
    header = ros.std_msgs__msg__Header(ros.builtin_interfaces__msg__Time(sec, nanosec), "")
    arrays = (np.array(values, dtype=np.float64) for values in (state.position, state.velocity, state.effort))
    message = ros.sensor_msgs__msg__JointState(header, list(state.names), *arrays)
    return bytes(typestore().serialize_cdr(message, JOINT_STATE))


def swing(
    joint: str, others: Mapping[str, float], seconds: float = 4.0, far: float = 0.4
) -> list[tuple[float, dict[str, float]]]:
    """Return the times and the positions by joint. One joint moves by ``far`` and stays there; the other joints are at
    rest."""
    times = np.arange(0.0, seconds, 0.05)
    way = far * 0.5 * (1.0 - np.cos(np.pi * np.clip(times / (seconds - 1.0), 0.0, 1.0)))
    return [(1e3 + float(at), {**others, joint: float(place)}) for at, place in zip(times, way, strict=True)]
