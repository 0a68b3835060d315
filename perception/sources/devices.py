"""List the cameras connected to this machine, and check access to them."""

import grp
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.paths import resolved
from drivers.port.owners import port_owners
from perception.perception_errors import CameraBusy, CameraDenied, CameraError, CameraMissing, unreadable

BY_ID: Final = "dev/v4l/by-id"
WATCHERS: Final = ("pipewire", "wireplumber")
"""Desktop programs that keep every camera open, but use the camera only on request."""


@dataclass(frozen=True, slots=True)
class CameraDevice:
    """A camera connected to this machine."""

    device: str
    """Path, such as /dev/video0."""
    index: int
    name: str
    by_id: str | None
    """Path that stays the same when the camera is plugged in again. None if the camera has no such path."""
    may_open: bool
    """Whether this user may open the camera."""
    owners: tuple[str, ...]
    """Programs that are using the camera."""


def cameras(root: Path = Path("/")) -> list[CameraDevice]:
    """Return the cameras connected to this machine, without opening them. ``root`` is the root of the file system."""
    return sorted(_cameras(root), key=lambda camera: camera.index)


def _cameras(root: Path) -> Iterator[CameraDevice]:
    links = sorted((root / BY_ID).glob("*"))
    for folder in (root / "sys/class/video4linux").glob("video*"):
        number = folder.name.removeprefix("video")
        if not number.isdecimal() or _text(folder / "index") not in ("0", ""):
            continue  # a second device node of the same camera, which delivers metadata
        path = root / "dev" / folder.name
        link = next((link for link in links if resolved(link) == resolved(path)), None)
        yield CameraDevice(
            device=f"/dev/{folder.name}",
            index=int(number),
            name=_text(folder / "name") or "camera",
            by_id=None if link is None else f"/{BY_ID}/{link.name}",
            may_open=os.access(path, os.R_OK | os.W_OK),
            owners=tuple(_users(path)),
        )


def find_device(source: str, root: Path = Path("/")) -> str:
    """Return the path of a camera that this program can use.

    Args:
        source: Path or index of the camera.
        root: Root of the machine's file system.

    Raises:
        CameraMissing: The camera does not exist. The message lists the cameras connected to this machine.
        CameraDenied: The user does not have permission to open the camera.
        CameraBusy: Another program is using the camera. The message names the program.
    """
    device = f"/dev/video{source.lstrip('0') or '0'}" if source.isdecimal() else source
    path = root / device.lstrip("/")
    try:
        exists = path.exists()
    except OSError as error:
        raise CameraError(unreadable(path, error)) from error
    if not exists:
        raise CameraMissing(f"there is no camera {device}: {_others(root)}")
    if not os.access(path, os.R_OK | os.W_OK):
        group = _group(path)
        raise CameraDenied(
            f"only members of the group '{group}' may open {device}: run 'sudo usermod -aG {group} $USER', then log "
            "out and in again"
        )
    if users := list(_users(path)):
        raise CameraBusy(f"{device} is in use by {', '.join(users)}: end that program first")
    return device


def _others(root: Path) -> str:
    found = [f"{camera.by_id or camera.device} ({camera.name})" for camera in cameras(root)]
    return (
        f"choose {' or '.join(found)}"
        if found
        else "plug in a camera, and list the cameras with 'servoloop camera list'"
    )


def _users(path: Path) -> Iterator[str]:
    return (owner for owner in port_owners(path) if not owner.startswith(WATCHERS))


def _group(path: Path) -> str:
    number = path.stat().st_gid
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:  # in a container, the group may have no name
        return str(number)


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""
