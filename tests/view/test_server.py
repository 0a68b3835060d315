"""Access control of the page's server, and errors of ``servoloop view``."""

import http.client
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from servoloop.commands.view import _opened
from servoloop.dashboard.server import PageServer, ViewError
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.arm_options import RunningChoice
from sim_backend.clock import SimulatedClock
from tests.complaint import complaint
from tests.live.rig import runtime_folder

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture(scope="module")
def local() -> Iterator[PageServer]:
    server = PageServer(port=0)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def open_to_others() -> Iterator[PageServer]:
    """Serve the page at an address of this machine that is not one of its host names, as all addresses of 127.x.x.x
    are."""
    server = PageServer("127.0.0.2", port=0)
    yield server
    server.stop()


def get(server: PageServer, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection(server.get_host(), server.get_port(), timeout=10.0)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def websocket(server: PageServer, origin: str, **headers: str) -> int:
    """Return the HTTP status of a request for a websocket; the status is 101 if the websocket is opened."""
    url = f"ws://{server.get_host()}:{server.get_port()}"
    try:
        with connect(url, origin=Origin(origin), subprotocols=[PROTOCOL], additional_headers=headers):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


def own_origin(server: PageServer) -> str:
    return f"http://{server.get_host()}:{server.get_port()}"


def test_this_machine_gets_the_page_and_its_websocket(local: PageServer) -> None:
    assert local.token is None and local.url == f"{own_origin(local)}/"
    response = get(local)
    assert response.status == 200 and b"<html" in response.read()
    assert get(local, Host=f"localhost:{local.get_port()}").status == 200
    assert websocket(local, own_origin(local)) == 101


def test_other_sites_cannot_open_the_websocket_through_a_local_browser(local: PageServer) -> None:
    for origin in ("http://evil.example", f"http://localhost:{local.get_port() + 1}", "null"):
        assert websocket(local, origin) == 403, origin
    assert get(local, Host=f"evil.example:{local.get_port()}").status == 403, (
        "a host name that resolves to this machine"
    )


def test_other_machines_are_refused_without_the_token(open_to_others: PageServer) -> None:
    token, origin = open_to_others.token, own_origin(open_to_others)
    assert token is not None and len(token) >= 32 and open_to_others.url == f"{origin}/?token={token}"
    for path in ("/", "/index.html", "/?token=", "/?token=wrong", f"/?token={token[:-1]}"):
        response = get(open_to_others, path)
        assert response.status == 403 and b"token" in response.read(), path
    assert websocket(open_to_others, origin) == 403
    assert websocket(open_to_others, origin, Cookie=f"{cookie_name(open_to_others)}=wrong") == 403


def test_the_token_sets_a_cookie_that_opens_the_page(open_to_others: PageServer) -> None:
    response = get(open_to_others, f"/?token={open_to_others.token}")
    cookie, *flags = (response.getheader("Set-Cookie") or "").split("; ")
    assert response.status == 303 and response.getheader("Location") == "/", "the token leaves the address bar"
    assert {"HttpOnly", "SameSite=Strict"} <= set(flags)
    assert get(open_to_others, Cookie=cookie).status == 200
    assert websocket(open_to_others, own_origin(open_to_others), Cookie=cookie) == 101
    assert websocket(open_to_others, "http://evil.example", Cookie=cookie) == 403


def cookie_name(server: PageServer) -> str:
    return f"servoloop_view_{server.get_port()}"


def test_each_server_has_its_own_token(open_to_others: PageServer) -> None:
    second = PageServer("127.0.0.2", port=0)
    second.stop()
    assert second.token != open_to_others.token


def test_the_public_tunnel_of_viser_is_refused(local: PageServer) -> None:
    assert local.request_share_url() is None


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(ViewError, match="--host must be an IPv4 address of this machine"):
        PageServer("192.0.2.1", port=0)


def test_without_a_stack_the_command_explains_how_to_start_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with runtime_folder(monkeypatch):
        assert "start one with `servoloop up`" in complaint(capsys, monkeypatch, "view")
    assert "cannot read" in complaint(capsys, monkeypatch, "view", "none.mcap")
    assert "cannot read" in complaint(capsys, monkeypatch, "view", "none.mcap", "--arm", "koch")
    assert "use only one of them" in complaint(capsys, monkeypatch, "view", "none.mcap", "--bus", "./bus")


def test_the_page_is_given_the_folder_of_the_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    mine, clock = Path("/mine"), SimulatedClock()
    monkeypatch.setattr("servoloop.recording.sources.PlayedRecording", lambda path: path)
    monkeypatch.setattr(
        "servoloop.recording.sources.LiveSource", lambda arm, clock, namespace: SimpleNamespace(folder=mine)
    )
    monkeypatch.setattr("servoloop.commands.view._emulated", lambda bus, arm, clock: bus)
    so101, file = find_arm("so101").folder, Path("run.mcap")
    assert _opened(None, None, RunningChoice(), clock)[1] == mine
    assert _opened(None, Path("bus"), RunningChoice("so101"), clock)[1] == so101
    assert [_opened(file, None, RunningChoice(arm), clock)[1] for arm in ("so101", None)] == [so101, None]
