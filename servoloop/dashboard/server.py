"""The web server of the page: on this machine, or on an address with a token; no other page may use it."""

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

from drivers.errors import DriverError

LOCALHOST: Final = "127.0.0.1"
NAMES: Final = ("localhost", LOCALHOST)
PORT: Final = 8080
TOKEN: Final = "token"


class ViewError(DriverError):
    """The view cannot be shown."""


class Guard:
    """Decides of each request whether it is answered, before a page or a websocket is served.

    Browsers let any page of any site open a websocket to this machine, so its origin must be the page itself. The name
    by which it was asked must be this machine's, so that no site can take its place by a name of its own.
    """

    def __init__(self, local: bool, token: str | None) -> None:
        """``local``: only asked by names of this machine. ``token``: what a browser must show once; None: none."""
        self._local = local
        self._token = token

    def refusal(self, request: Request) -> Response | None:
        """The response to a request that must not be served, None for one that may."""
        host = request.headers.get("Host", "")
        origin = request.headers.get("Origin")
        if self._local and urlsplit(f"//{host}").hostname not in NAMES:
            return _answer(http.HTTPStatus.FORBIDDEN, "ask for localhost")
        if origin is not None and urlsplit(origin).netloc != host:
            return _answer(http.HTTPStatus.FORBIDDEN, "another site may not use this page")
        if self._token is None or self._same(self._cookie(request, host)):
            return None
        path = urlsplit(request.path)
        if not self._same(parse_qs(path.query).get(TOKEN, [""])[0]):
            return _answer(http.HTTPStatus.FORBIDDEN, "the token is missing: open the address that was printed")
        cookie = f"{_name(host)}={self._token}; HttpOnly; SameSite=Strict; Path=/"
        return _answer(http.HTTPStatus.SEE_OTHER, "", ("Location", path.path or "/"), ("Set-Cookie", cookie))

    def _same(self, shown: str) -> bool:
        return self._token is not None and hmac.compare_digest(shown.encode(), self._token.encode())

    def _cookie(self, request: Request, host: str) -> str:
        found = [SimpleCookie(text).get(_name(host)) for text in request.headers.get_all("Cookie")]
        return next((one.value for one in found if one is not None), "")


class PageServer(viser.ViserServer):
    """Viser's server, which only answers what its guard lets pass, and only at the address that it was given."""

    def __init__(self, host: str = LOCALHOST, port: int = PORT) -> None:
        """Serve at ``host``; where ``port`` is taken, at the next one that is free; 0: at any. Raises ViewError."""
        local = host in NAMES
        self.token = None if local else secrets.token_urlsafe(24)
        self._check_address(host)
        guard = Guard(local, self.token)
        with _guarded(guard) as served, contextlib.redirect_stdout(io.StringIO()):  # it prints a panel of its own
            super().__init__(host=host, port=port, label="servoloop", verbose=False)
        if not served:  # a viser that serves in another way would be open to all
            self.stop()
            raise ViewError("this viser cannot be guarded: install the version that servoloop names")
        self.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        token = "" if self.token is None else f"?{TOKEN}={self.token}"
        return f"http://{self.get_host()}:{self.get_port()}/{token}"

    def stop(self) -> None:
        """End, without viser's words about it."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Viser's tunnel through a server on the internet, which any open page may ask for: never."""
        return None

    def _check_address(self, host: str) -> None:
        """Viser waits for ever for an address that this machine has not."""
        try:
            with socket.create_server((host, 0), family=socket.AF_INET):
                pass
        except OSError as error:
            text = f"cannot serve at {host}: {error.strerror}. --host takes an IPv4 address of this machine"
            raise ViewError(text) from error


@contextlib.contextmanager
def _guarded(guard: Guard) -> Iterator[list[bool]]:
    """All that websockets serves in this context asks the guard first; the list stays empty where nothing is served."""
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
    """Browsers send cookies to all ports of a machine: each page has its own."""
    return f"servoloop_view_{urlsplit(f'//{host}').port or 80}"


def _answer(status: http.HTTPStatus, text: str, *headers: tuple[str, str]) -> Response:
    body = text.encode()
    fields = Headers([("Content-Type", "text/plain"), ("Content-Length", str(len(body))), *headers])
    return Response(status, status.phrase, fields, body)
