"""Two independent readers of recordings: rosbags, and the mcap library with its ROS 2 decoder."""

from collections import defaultdict
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

Messages = dict[str, list[Any]]
"""Messages by topic, in the order of the file."""


def by_rosbags(path: Path) -> Messages:
    """Read a file with rosbags, which reads types that Jazzy does not know from the schemas of the file."""
    found: Messages = defaultdict(list)
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            found[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return found


def by_mcap(path: Path) -> Messages:
    """Read a file with the mcap library, using only the schemas in the file."""
    found: Messages = defaultdict(list)
    with path.open("rb") as stream:
        for decoded in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found[decoded.channel.topic].append(decoded.decoded_message)
    return found


def faults(path: Path) -> list[str]:
    """Return the faults for which files were written, as "joint: kind", in order."""
    with path.open("rb") as stream:
        return [text for record in make_reader(stream).iter_metadata() for text in record.metadata.values()]


def stamp_s(message: Any) -> float:
    """Return the time in a message's header, in seconds."""
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
