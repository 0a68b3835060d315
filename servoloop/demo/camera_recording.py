"""Add the camera images to the recording of a stack.

The control loop process writes the recording. Until that process ends, the images are kept in a separate file.
"""

import heapq
import logging
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import Self

from mcap.reader import McapReader, make_reader

from servoloop.recording.mcap import SUFFIX, McapFile, RecordingError
from servoloop.recording.message_types import PICTURE, definition

LOG = logging.getLogger("servoloop")


class CameraRecording:
    """Camera images of one run, in a file next to the stack's recording.

    When the context ends, the images are added to the recording. If the run failed, an error in this step is only
    logged, because the error of the run explains it.
    """

    def __init__(self, recording: Path, topic: str) -> None:
        """Create the image file. Raises RecordingError if the file cannot be created."""
        self._recording, self._topic = recording, topic
        self.pictures = recording.with_suffix(f".camera{SUFFIX}")
        """File that holds the images until ``finish`` has added them to the recording."""
        self._file = McapFile(self.pictures)
        self._file.add_channel(topic, PICTURE, definition(PICTURE))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, failure: BaseException | None, trace: object) -> None:
        try:
            self.finish()
        except RecordingError as error:
            if failure is None:
                raise
            LOG.error("%s", error)

    def add(self, stamp_ns: int, data: bytes) -> None:
        """Write an encoded image."""
        self._file.add_message(self._topic, stamp_ns, data)

    def finish(self) -> None:
        """Close the image file, and add the images to the recording, ordered by time.

        Call this after the stack has ended. If the stack did not start, there is no recording, and the images are
        deleted.

        Raises:
            RecordingError: The recording cannot be read or written. Both files are then kept.
        """
        self._file.close()
        if self._recording.exists():
            self._merge()
        self.pictures.unlink()

    def _merge(self) -> None:
        whole = self._recording.with_suffix(f".part{SUFFIX}")
        whole.unlink(missing_ok=True)
        try:
            with self._recording.open("rb") as run, self.pictures.open("rb") as pictures:
                _write(whole, make_reader(run), make_reader(pictures))
            whole.replace(self._recording)
        except RecordingError:
            raise
        except Exception as error:  # damaged data raise errors of many types
            reason = getattr(error, "strerror", None) or "the recording is incomplete or damaged"
            raise RecordingError(
                f"cannot add the camera images to {self._recording}: {reason}; the images remain in {self.pictures}"
            ) from error
        finally:
            whole.unlink(missing_ok=True)


def _write(path: Path, *readers: McapReader) -> None:
    merged = McapFile(path)
    try:
        for reader in readers:
            for metadata in reader.iter_metadata():
                merged.add_metadata(metadata.name, metadata.metadata)
        for stamp_ns, schema, topic, data in heapq.merge(*map(_messages, readers), key=itemgetter(0)):
            if not merged.has_channel(topic):
                merged.add_channel(topic, *schema)
            merged.add_message(topic, stamp_ns, data)
    finally:
        merged.close()


def _messages(reader: McapReader) -> Iterator[tuple[int, tuple[str, str], str, bytes]]:
    """Yield the messages of a file in chronological order: time in ns, schema, topic and data."""
    for schema, channel, message in reader.iter_messages():
        assert schema is not None
        yield message.log_time, (schema.name, schema.data.decode()), channel.topic, message.data
