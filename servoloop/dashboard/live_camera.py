"""Pictures of the running camera node for the page of ``servoloop view``."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from servoloop.recording.pictures import CameraPicture

if TYPE_CHECKING:
    from nodes.clients.camera_pictures import PictureWatch


class LiveCamera:
    """Newest picture of the camera node."""

    def __init__(self, watch: "PictureWatch", topic: str) -> None:
        self._watch, self._topic = watch, topic
        self._message: object = None
        self._pictures: Mapping[str, CameraPicture] = {}

    def pictures(self) -> Mapping[str, CameraPicture]:
        """Return the newest picture by its topic; nothing if no camera runs."""
        newest = self._watch.newest
        if newest is not self._message:
            self._message = newest
            found = {} if newest is None else {self._topic: CameraPicture(newest.format, bytes(newest.data))}
            self._pictures = found
        return self._pictures

    def close(self) -> None:
        """End the watch."""
        self._watch.close()
