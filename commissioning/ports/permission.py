"""Who may open a device, and the one command that helps who may not."""

import grp
import stat
from dataclasses import dataclass
from typing import Final

from commissioning.ports.machine import Machine, User

USUAL_GROUP: Final = "dialout"
"""Of serial devices on Debian and its relatives. Whoever joins the group root may do far more than open ports."""


@dataclass(frozen=True, slots=True)
class Permission:
    """``mode`` as chmod writes it. ``joined``: the user is in the group, but not yet in this login."""

    mode: str
    group: str
    may_open: bool
    joined: bool

    def advice(self, user: str) -> str | None:
        """The command; None for a user who may."""
        if self.may_open:
            return None
        if self.joined:
            return f"newgrp {self.group}"
        return f"sudo usermod -aG {USUAL_GROUP if self.group == 'root' else self.group} {user}"


def permission(machine: Machine, device: str) -> Permission | None:
    """What the device's owner, group and mode let the user do; None where it is gone."""
    try:
        status = machine.path(device).stat()
    except OSError:
        return None
    group, members = _group(status.st_gid)
    may_open = _may_open(machine.user, status.st_uid, status.st_gid, status.st_mode)
    joined = not may_open and bool(status.st_mode & stat.S_IWGRP) and machine.user.name in members
    return Permission(f"{stat.S_IMODE(status.st_mode):04o}", group, may_open, joined)


def _may_open(user: User, owner: int, group: int, mode: int) -> bool:
    """The kernel's own rule: the first that fits decides. Root may always."""
    if user.uid == 0:
        return True
    if user.uid == owner:
        return mode & 0o600 == 0o600
    return mode & (0o060 if group in user.groups else 0o006) in (0o060, 0o006)


def _group(group_id: int) -> tuple[str, list[str]]:
    try:
        entry = grp.getgrgid(group_id)
    except KeyError:
        return str(group_id), []
    return entry.gr_name, entry.gr_mem
