"""Images from the running camera node for the page of ``servoloop view``."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from servoloop.recording.pictures import CameraPicture

if TYPE_CHECKING:
    from nodes.clients.camera_pictures import PictureWatch


class LiveCamera:
    """Latest image of the camera node."""

    def __init__(self, watch: "PictureWatch", topic: str) -> None:
        self._watch, self._topic = watch, topic
        self._message: object = None
        self._pictures: Mapping[str, CameraPicture] = {}

    def pictures(self) -> Mapping[str, CameraPicture]:
        """Return the latest image, keyed by its topic, or an empty mapping if no camera is running."""
        newest = self._watch.newest
        if newest is not self._message:
            self._message = newest
            found = {} if newest is None else {self._topic: CameraPicture(newest.format, bytes(newest.data))}
            self._pictures = found
        return self._pictures

    def close(self) -> None:
        """Stop watching the camera node."""
        self._watch.close()
