"""Who may reach the operator's page, and what can't hold it up."""

import asyncio
import socket
from contextlib import ExitStack
from urllib.parse import urlsplit

import pytest

from bringup.view_results import frames, get, serving
from roller_bringup import cli
from roller_bringup.view.access import _is_loopback
from roller_bringup.view.http_server import _MOST_CONNECTIONS, AddressError
from roller_bringup.view.scene import Scene
from roller_bringup.view.server import PageServer
from roller_bringup.view.viewers import QUEUE, Viewer
from waiting import wait_until


def test_other_machines_need_the_token(monkeypatch):
    assert not any(map(_is_loopback, ("0.0.0.0", "::", "192.168.1.2", "cell.example")))
    assert all(map(_is_loopback, ("localhost", "127.0.0.1", "127.0.0.2", "::1")))
    monkeypatch.setattr("roller_bringup.view.access._is_loopback", lambda host: False)
    with serving(Scene("x")) as server:  # not where others could see it
        for path in ("/", "/api/map", "/api/events", "/page/main.js", "/?token=wrong"):
            assert get(server, path)[0] == 401, path
        assert server.token in server.url
        status, headers, _ = get(server, f"/?{urlsplit(server.url).query}")
        assert (status, headers["location"]) == (303, "/")
        cookie = headers["set-cookie"].partition(";")[0]
        assert "httponly" in headers["set-cookie"].lower()
        assert get(server, "/", Cookie=cookie)[0] == 200


def test_pages_of_elsewhere_reach_nothing():
    with serving(Scene("x")) as server:
        assert server.token == ""
        assert get(server, "/api/text", Host=f"evil.example:{server.port}")[0] == 421
        for host in ("localhost", "LOCALHOST", "127.0.0.1", "[::1]"):
            assert get(server, "/api/text", Host=f"{host}:{server.port}")[0] == 200, host
        for host in ("[::1", "", "evil.example:x", "evil.example:999999", "127.0.0.1@evil.example"):
            assert get(server, "/api/text", Host=host)[0] == 421, host


@pytest.mark.parametrize("before", [b"", b"GET /api/text HTTP/1.1\r\nHost: localhost\r\n\r\n"])
def test_connections_that_ask_for_nothing_are_closed(monkeypatch, before):
    monkeypatch.setattr("roller_bringup.view.http_server._REQUEST_S", 0.5)
    with serving(Scene("x")) as server, ExitStack() as stack:
        halves = []
        for _ in range(_MOST_CONNECTIONS):
            half = socket.create_connection(("127.0.0.1", server.port), 20)
            halves.append(stack.enter_context(half))
            half.sendall(before + b"GET /api/text HTTP/1.1\r\n")
        for half in halves:  # until it is closed
            while half.recv(65536):
                pass
        wait_until(lambda: get(server, "/api/text")[0] == 200)
        stream = frames(server)  # one that listens stays
        for _ in range(3):
            next(stream)
        assert get(server, "/api/text")[0] == 200


def test_an_address_that_is_taken_is_one_line():
    with serving(Scene("x")) as server, pytest.raises(AddressError, match="can't listen there"):
        PageServer(Scene("y"), port=server.port)


def test_an_address_that_is_taken_is_said_before_a_recording_is_replayed(
    tmp_path, capsys, monkeypatch
):
    def replayed(*_):
        raise AssertionError("minutes for nothing")

    monkeypatch.setattr("roller_bringup.view.recorded.results_of", replayed)
    with serving(Scene("x")) as server:
        assert cli.main(["view", str(tmp_path), "--port", str(server.port)]) == 1
    assert "can't listen there" in capsys.readouterr().err


def test_a_host_that_is_no_name_is_one_line():
    with pytest.raises(AddressError, match="can't listen there"):
        PageServer(Scene("x"), host="\udcff")


def test_a_slow_browser_misses_the_oldest_frames():
    async def look_on() -> list[bytes]:
        viewer = Viewer()
        for k in range(10):
            viewer.offer(b"%d" % k)
        assert viewer.dropped == 10 - QUEUE
        stream = viewer.frames()
        return [await anext(stream) for _ in range(QUEUE)]

    assert asyncio.run(look_on()) == [b"6", b"7", b"8", b"9"]


def test_a_browser_that_reads_nothing_holds_up_no_other():
    scene = Scene("x")
    with serving(scene) as server, socket.create_connection(("127.0.0.1", server.port)) as stuck:
        stuck.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        wait_until(lambda: len(server.viewers) == 1)
        for number, state in enumerate(frames(server)):
            scene.title = f"{number}" + "x" * 2_000_000  # fills what the system holds for a socket
            if state["dropped_frames"]:
                break
        assert state["viewers"] == 2


def test_who_comes_as_another_leaves_waits_for_nothing(monkeypatch):
    """A page that is loaded again: there are as many as before, and nothing has changed."""
    monkeypatch.setattr("roller_bringup.view.server._HEARTBEAT_S", 3600.0)
    monkeypatch.setattr("roller_bringup.view.server._PERIOD_S", 1.0)
    with serving(Scene("x")) as server:
        first = frames(server)
        next(first)
        first.close()
        wait_until(lambda: not len(server.viewers))
        assert next(frames(server))["title"] == "x"
