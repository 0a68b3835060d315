"""Camera images on the page of ``servoloop view``."""

import base64
from collections.abc import Callable, Mapping
from html import escape
from typing import Final

import viser

from servoloop.recording.pictures import CameraPicture
from servoloop.recording.robot_state import ObservedRobot

IMAGE: Final = '<figure style="margin:0.5em 1em"><img alt="{name}" style="width:100%" src="data:{kind};base64,{data}">'
CAPTION: Final = '<figcaption style="font-size:0.78em">{name}</figcaption></figure>'
SUFFIX: Final = "/compressed"

LivePictures = Callable[[], Mapping[str, CameraPicture]]
"""Function that returns the latest image of each running camera, keyed by topic."""


class CameraFolder:
    """Folder on the page with the latest image of each camera. The folder appears when the first image arrives."""

    def __init__(self, server: viser.ViserServer, order: float, live: LivePictures | None = None) -> None:
        """Prepare the folder, which is created when the first image arrives.

        Args:
            server: Server of the page.
            order: Position of the folder among the controls.
            live: Function that returns the images of running cameras, or None to show only images of the observed
                robot.
        """
        self._server, self._order, self._live = server, order, live
        self._folder: viser.GuiFolderHandle | None = None
        self._places: dict[str, viser.GuiHtmlHandle] = {}
        self._shown: Mapping[str, CameraPicture] = {}

    def show(self, watched: ObservedRobot) -> None:
        """Update the images, and remove cameras without an image."""
        pictures = watched.pictures.newest if self._live is None else self._live()
        if pictures is self._shown:
            return
        for topic in self._places.keys() - pictures.keys():
            self._places.pop(topic).remove()
        for topic, picture in pictures.items():
            if picture is not self._shown.get(topic) and picture.media_type:
                self._place(topic).content = html(topic, picture)
        self._shown = pictures
        if not self._places and self._folder is not None:
            self._folder.remove()
            self._folder = None

    def _place(self, topic: str) -> viser.GuiHtmlHandle:
        if self._folder is None:
            self._folder = self._server.gui.add_folder("Camera", order=self._order)
        if topic not in self._places:
            with self._folder:
                self._places[topic] = self._server.gui.add_html("")
        return self._places[topic]


def html(topic: str, picture: CameraPicture) -> str:
    """Return an image as HTML that contains the image data, so that the browser does not send another request."""
    name = escape(topic.removesuffix(SUFFIX))
    data = base64.b64encode(picture.data).decode()
    return IMAGE.format(name=name, kind=picture.media_type, data=data) + CAPTION.format(name=name)
