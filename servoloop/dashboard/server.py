"""Web server of the page.

The server accepts only browsers on this machine or, with a token, browsers on other machines. It rejects requests from
other sites.
"""

import contextlib
import functools
import hmac
import http
import io
import secrets
import socket
from collections.abc import Callable, Iterator
from http.cookies import SimpleCookie
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from drivers.driver_errors import DriverError

LOCALHOST: Final = "127.0.0.1"
NAMES: Final = ("localhost", LOCALHOST)
PORT: Final = 8080
TOKEN: Final = "token"


class ViewError(DriverError):
    """The page cannot be served."""


class Guard:
    """Guard that checks each request before a page or a websocket is served.

    Browsers let any site's page open a websocket to this machine, so the origin of a request must be the page itself.
    The host name in a request must be a name of this machine, which prevents DNS rebinding.
    """

    def __init__(self, local: bool, token: str | None) -> None:
        """Create the guard.

        Args:
            local: Whether only host names of this machine are accepted.
            token: Token that a browser must present once, or None if no token is needed.
        """
        self._local = local
        self._token = token

    def refusal(self, request: Request) -> Response | None:
        """Return the response to a request that must be rejected, or None if the request may be served."""
        host = request.headers.get("Host", "")
        origin = request.headers.get("Origin")
        if self._local and urlsplit(f"//{host}").hostname not in NAMES:
            return _answer(http.HTTPStatus.FORBIDDEN, "open this page as localhost")
        if origin is not None and urlsplit(origin).netloc != host:
            return _answer(http.HTTPStatus.FORBIDDEN, "requests from other sites are not allowed")
        if self._token is None or self._same(self._cookie(request, host)):
            return None
        path = urlsplit(request.path)
        if not self._same(parse_qs(path.query).get(TOKEN, [""])[0]):
            return _answer(
                http.HTTPStatus.FORBIDDEN, "the token is missing; open the address that servoloop view has printed"
            )
        cookie = f"{_name(host)}={self._token}; HttpOnly; SameSite=Strict; Path=/"
        return _answer(http.HTTPStatus.SEE_OTHER, "", ("Location", path.path or "/"), ("Set-Cookie", cookie))

    def _same(self, shown: str) -> bool:
        return self._token is not None and hmac.compare_digest(shown.encode(), self._token.encode())

    def _cookie(self, request: Request, host: str) -> str:
        found = [SimpleCookie(text).get(_name(host)) for text in request.headers.get_all("Cookie")]
        return next((one.value for one in found if one is not None), "")


class PageServer(viser.ViserServer):
    """Viser server that serves only requests allowed by a guard, and only at the given address."""

    def __init__(self, host: str = LOCALHOST, port: int = PORT) -> None:
        """Start the server.

        Args:
            host: IPv4 address of this machine, or localhost.
            port: First port to try. If the port is in use, the next free port is used; 0 selects any free port.

        Raises:
            ViewError: The server cannot use the address.
        """
        local = host in NAMES
        self.token = None if local else secrets.token_urlsafe(24)
        self._check_address(host)
        guard = Guard(local, self.token)
        with _guarded(guard) as served, contextlib.redirect_stdout(io.StringIO()):  # viser prints a startup panel
            super().__init__(host=host, port=port, label="servoloop", verbose=False)
        if not served:  # this version of viser does not use websockets, so the guard has no effect
            self.stop()
            raise ViewError(
                "access to the page cannot be restricted with this version of viser; install the pinned version"
            )
        self.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")

    @property
    def url(self) -> str:
        """URL of the page, including its token."""
        token = "" if self.token is None else f"?{TOKEN}={self.token}"
        return f"http://{self.get_host()}:{self.get_port()}/{token}"

    def stop(self) -> None:
        """Stop the server without printing viser's messages."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Reject viser's public tunnel, which any open page could request."""
        return None

    def _check_address(self, host: str) -> None:
        """Raise ViewError if the machine does not have this address, because viser would wait for the address
        forever."""
        try:
            with socket.create_server((host, 0), family=socket.AF_INET):
                pass
        except OSError as error:
            text = f"cannot serve at {host}: {error.strerror}; --host must be an IPv4 address of this machine"
            raise ViewError(text) from error


@contextlib.contextmanager
def _guarded(guard: Guard) -> Iterator[list[bool]]:
    """Let the guard check all requests to servers that websockets starts within this context.

    The yielded list has an entry for each server.
    """
    serve, served = websockets.asyncio.server.serve, []

    @functools.wraps(serve)
    def guarded(*arguments: Any, process_request: Callable[..., Any] | None = None, **options: Any) -> Any:
        def process(connection: Any, request: Request) -> Any:
            refused = guard.refusal(request)
            if refused is not None or process_request is None:
                return refused
            return process_request(connection, request)

        served.append(True)
        return serve(*arguments, process_request=process, **options)

    websockets.asyncio.server.serve = guarded  # type: ignore[assignment,misc]
    try:
        yield served
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]


def _name(host: str) -> str:
    """Return the name of the cookie.

    The name contains the port, because browsers send a machine's cookies to all of its ports.
    """
    return f"servoloop_view_{urlsplit(f'//{host}').port or 80}"


def _answer(status: http.HTTPStatus, text: str, *headers: tuple[str, str]) -> Response:
    body = text.encode()
    fields = Headers([("Content-Type", "text/plain"), ("Content-Length", str(len(body))), *headers])
    return Response(status, status.phrase, fields, body)
