"""Latest image of each camera, from the messages of a recording or from a live camera node."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from servoloop.recording.mcap_messages import COMPRESSED, Received

ENCODINGS: Final = {"jpeg": "image/jpeg", "jpg": "image/jpeg", "png": "image/png"}
"""Media types of the encodings that browsers can show, keyed by a substring of the message format."""


class CameraPicture(NamedTuple):
    """Encoded camera image."""

    format: str
    """Format of the message, such as ``jpeg`` or ``rgb8; jpeg compressed bgr8``."""
    data: bytes

    @property
    def media_type(self) -> str:
        """Media type, or an empty string if browsers cannot show this encoding."""
        return next((kind for part, kind in ENCODINGS.items() if part in self.format.lower()), "")


class Pictures:
    """Latest image of each camera. One thread updates the images; any thread may read them."""

    def __init__(self) -> None:
        self.newest: Mapping[str, CameraPicture] = {}
        """Images, keyed by topic."""

    def take(self, received: Received) -> None:
        """Store the image from a message. Messages without an image are ignored."""
        if received.topic.endswith(COMPRESSED):
            message = received.message
            picture = CameraPicture(message.format, message.data.tobytes())
            self.newest = {**self.newest, received.topic: picture}
