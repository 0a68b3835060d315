"""Decide which client may move the arm."""

import threading
from collections.abc import Callable
from typing import Any, Protocol

from servoloop.command_socket.command_errors import CommandError


class Owner(Protocol):
    """Client that can take control of the arm."""

    @property
    def name(self) -> str:
        """Name of the client in messages."""
        ...

    def post(self, message: dict[str, Any]) -> None:
        """Send an event to the client without waiting."""
        ...


class Ownership:
    """Control of the arm's motion. At most one client has control. Any thread may call each method.

    ``halt`` stops the motions of a client within their limits.
    """

    def __init__(self, halt: Callable[[Owner], None]) -> None:
        self._halt = halt
        self._lock = threading.RLock()
        self._owner: Owner | None = None

    @property
    def owner(self) -> str:
        """Name of the owner, or an empty string if no client has control of the arm."""
        owner = self._owner
        return owner.name if owner is not None else ""

    def take(self, client: Owner, force: bool) -> None:
        """Give a client control of the arm.

        Args:
            client: The client.
            force: Whether to take control from another client, whose motions then stop.

        Raises:
            CommandError: Another client is the owner.
        """
        with self._lock:
            if self._owner not in (None, client):
                if not force:
                    text = f"{self.owner} has control of the arm: end that program, or take control by force"
                    raise CommandError("owned", text)
                self.end(f"{client.name} has taken control of the arm by force")
            self._owner = client

    def release(self, client: Owner) -> None:
        """Stop the motions of a client, and release its control of the arm."""
        with self._lock:
            self._halt(client)
            if self._owner is client:
                self._owner = None

    def end(self, why: str) -> None:
        """Stop the motions of the owner, which must take control again before it can move the arm."""
        with self._lock:
            owner, self._owner = self._owner, None
            if owner is not None:
                self._halt(owner)
                owner.post({"event": "lost", "text": why})

    def require(self, client: Owner) -> None:
        """Raise CommandError if a client does not have control of the arm."""
        self.moving(client, dict)

    def moving(self, client: Owner, move: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Call ``move`` while a client has control of the arm. Raises CommandError if the client does not have
        control."""
        with self._lock:
            if self._owner is not client:
                owner = f"{self.owner} has control" if self._owner is not None else "send take first"
                raise CommandError("not_owner", f"this client does not have control of the arm: {owner}")
            return move()
