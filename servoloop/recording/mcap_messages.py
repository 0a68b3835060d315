"""Read the messages of an MCAP file or stream, even if it is incomplete or damaged."""

import logging
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Message, Schema

from servoloop.recording.mcap import RecordingError
from servoloop.recording.message_types import (
    CYCLE,
    DIAGNOSTICS,
    GOAL_RESULT,
    JOINT_STATE,
    PICTURE,
    STRING,
    TF,
    TRAJECTORY,
    typestore,
)

LOG = logging.getLogger("servoloop")

STATES, COMMANDS, CYCLES = "/joint_states", "/servoloop/commands", "/servoloop/cycles"
STATUSES, SCENE, URDF = "/diagnostics", "/servoloop/scene", "/robot_description"
GOAL, RESULT = "/goal", "/goal_result"
COMPRESSED: Final = "/image_raw/compressed"
"""Topic suffix for camera images."""
MAGIC: Final = b"\x89MCAP"
OTHER_FORMATS: Final = {
    b"SQLite format 3": "is a rosbag2 database: convert it with `ros2 bag convert`",
    b"#ROSBAG V": "is a recording of ROS 1: convert it with `rosbags-convert`",
    b"\x28\xb5\x2f\xfd": "is compressed: decompress it with `zstd -d`",
    b"\x1f\x8b": "is compressed: decompress it with `gunzip`",
}
"""Descriptions of other file formats, keyed by the first bytes of a file."""
KINDS: Final = {
    STATES: (JOINT_STATE,),
    COMMANDS: (JOINT_STATE,),
    CYCLES: (CYCLE,),
    STATUSES: (DIAGNOSTICS,),
    SCENE: (TF,),
    URDF: (STRING,),
}
Encoded = tuple[Schema, Channel, Message]
OpenFile = Callable[[Path], IO[bytes]]


class Received(NamedTuple):
    """Decoded message with its topic. ``sequence`` counts the cycles of a live stack, so gaps reveal lost cycles."""

    topic: str
    stamp_ns: int
    """ROS time, in nanoseconds."""
    message: Any
    sequence: int


def kinds_of(topic: str) -> tuple[str, ...]:
    """Return the message types of a topic that carries robot state, or no types for any other topic."""
    if topic.endswith(GOAL):
        return TRAJECTORY, JOINT_STATE
    if topic.endswith(COMPRESSED):
        return (PICTURE,)
    return (GOAL_RESULT,) if topic.endswith(RESULT) else KINDS.get(topic, ())


def encoded(reader: NonSeekingReader, file: str | None = None) -> Iterator[Encoded]:
    """Yield the messages from a reader until its stream ends, is closed or is damaged.

    Args:
        reader: Reader of a stream.
        file: File name to use in the warning about a damaged file. None if the stream is live.
    """
    try:
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if schema is not None:
                yield schema, channel, message
    except (EndOfFile, struct.error):  # The file is truncated in the middle of a record.
        return
    except Exception as error:  # each compression format raises its own errors for damaged data
        if file is not None:
            LOG.warning("%s is damaged; only the part before the damage is used: %s", file, error)


def decoded(messages: Iterable[Encoded]) -> Iterator[Received]:
    """Decode and yield the robot state messages. Skip messages that do not match their type."""
    decode = typestore().deserialize_cdr
    for schema, channel, message in messages:
        if schema.name not in kinds_of(channel.topic) or channel.message_encoding != "cdr":
            continue
        try:
            content = decode(message.data, schema.name)
        except Exception:  # The message is damaged, or its type has a different version.
            LOG.debug("a message on %s does not match the type %s", channel.topic, schema.name)
            continue
        yield Received(channel.topic, message.log_time, content, message.sequence)


def open_file(path: Path) -> IO[bytes]:
    """Open a file for reading."""
    return path.open("rb")


def read_messages(path: Path, open_file: OpenFile = open_file) -> Iterator[Received]:
    """Yield the robot state messages from a recording, which may be incomplete.

    Args:
        path: Path of the file.
        open_file: Function that opens the file. A caller that shows progress passes a function that counts the bytes
            read.

    Raises:
        RecordingError: The file cannot be read, or it is not an MCAP file.
    """
    try:
        with open_file(path) as stream:
            _require_mcap(stream, path)
            reader = NonSeekingReader(stream, validate_crcs=True, record_size_limit=path.stat().st_size)
            yield from decoded(encoded(reader, str(path)))
    except (OSError, McapError) as error:
        raise RecordingError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error


def _require_mcap(stream: IO[bytes], path: Path) -> None:
    """Raise RecordingError if the start of a file does not match the MCAP format."""
    head = stream.read(512)
    stream.seek(0)
    if head.startswith(MAGIC):
        return
    found = next((text for start, text in OTHER_FORMATS.items() if head.startswith(start)), None)
    if found is None:
        found = f"is {_described(head)}, not an MCAP recording: choose a file written with --record"
    raise RecordingError(f"{path} {found}")


def _described(head: bytes) -> str:
    if not head:
        return "an empty file"
    text = head.decode("utf-8", errors="ignore")  # The last character may be truncated.
    plain = len(text.encode()) > len(head) - 4 and all(letter.isprintable() or letter.isspace() for letter in text)
    return "a text file" if plain else "a file of another format"
