"""Pictures of the running camera node for the page of ``servoloop view``. Imports rclpy."""

from collections.abc import Mapping

from drivers.clock import Clock
from nodes.clients.camera_pictures import PICTURES, PictureWatch
from servoloop.recording.pictures import CameraPicture


class LiveCamera:
    """Newest picture of the camera node."""

    def __init__(self, clock: Clock, namespace: str) -> None:
        self._watch = PictureWatch(clock, namespace)
        self._message: object = None
        self._pictures: Mapping[str, CameraPicture] = {}

    def pictures(self) -> Mapping[str, CameraPicture]:
        """Return the newest picture by its topic; nothing if no camera runs."""
        newest = self._watch.newest
        if newest is not self._message:
            self._message = newest
            found = {} if newest is None else {PICTURES: CameraPicture(newest.format, bytes(newest.data))}
            self._pictures = found
        return self._pictures

    def close(self) -> None:
        """End the watch."""
        self._watch.close()
