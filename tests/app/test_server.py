"""The gate before viser, its port, and that nothing is printed."""

from __future__ import annotations

import socket
import urllib.error
import urllib.request
from types import SimpleNamespace

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from asdfviz.app import server
from asdfviz.app.server import Gate, is_loopback, outside_url, start_server, stop_server
from asdfviz.errors import InputError

OPEN = Gate(frozenset({"127.0.0.1", "localhost"}), None)
LOCKED = Gate(None, "sesame")
COOKIE = "asdfviz_token_d0c04f4b=sesame"
HERE = {"Host": "127.0.0.1:8080"}
SOCKET = {**HERE, "Upgrade": "websocket"}


@pytest.mark.parametrize(
    ("gate", "headers", "path", "status"),
    [
        (OPEN, HERE, "/", None),
        (OPEN, {"Host": "localhost:9"}, "/", None),
        (OPEN, {"Host": "evil.example:8080"}, "/", 403),
        (OPEN, {}, "/", 403),
        (OPEN, {**SOCKET, "Origin": "http://127.0.0.1:8080"}, "/", None),
        (OPEN, {**SOCKET, "Origin": "http://evil.example"}, "/", 403),
        (OPEN, {**SOCKET, "Origin": "http://127.0.0.1:9999"}, "/", 403),
        (OPEN, SOCKET, "/", 403),
        (LOCKED, HERE, "/", 401),
        (LOCKED, HERE, "/?token=wrong", 401),
        (LOCKED, HERE, "/?token=sesame", None),
        (LOCKED, {**HERE, "Cookie": COOKIE}, "/", None),
        (LOCKED, {**SOCKET, "Origin": "http://127.0.0.1:8080"}, "/?token=sesame", 401),
        (
            LOCKED,
            {**SOCKET, "Origin": "http://127.0.0.1:8080", "Cookie": COOKIE},
            "/",
            None,
        ),
    ],
)
def test_who_comes_in(gate: Gate, headers: dict[str, str], path: str, status: int | None) -> None:
    refusal = gate.refusal(Headers(headers), path)
    assert (None if refusal is None else refusal[0]) == status


@pytest.mark.parametrize(
    "other",
    ['p={"dark":true}', "x[y]=1", "name=Jörg", "foo", "a=1,2 3", "a/b=1", "@id=1", "=", ""],
)
def test_cookies_of_other_programs_change_nothing(other: str) -> None:
    for cookies in (f"{other}; {COOKIE}", f"{COOKIE}; {other}"):
        assert LOCKED.refusal(Headers({**HERE, "Cookie": cookies}), "/") is None
    refusal = LOCKED.refusal(Headers({**HERE, "Cookie": other}), "/")
    assert refusal is not None
    assert refusal[0] == 401


def test_two_apps_on_one_host_let_the_same_browser_in() -> None:
    gates = (LOCKED, Gate(None, "other"))
    given = [gate.welcome_cookie(Headers(HERE)) or "" for gate in gates]
    # A browser keeps one cookie of a name, whichever port of the host it came from.
    jar = dict(cookie.split(";")[0].split("=", 1) for cookie in given)
    back = {"Cookie": "; ".join(f"{name}={value}" for name, value in jar.items())}
    for gate in gates:
        assert gate.refusal(Headers({**HERE, **back}), "/") is None


def test_the_token_becomes_a_strict_cookie_once() -> None:
    cookie = LOCKED.welcome_cookie(Headers(HERE))
    assert cookie is not None
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert LOCKED.welcome_cookie(Headers({**HERE, "Cookie": COOKIE})) is None


@pytest.mark.parametrize(
    "token", ["a+b/c==", "a&b", "a#b", "100%25", "a b", "a;b", 'q"x', "geheïm", "sur\udcff"]
)
def test_a_token_may_hold_any_character(token: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # The server itself is not needed to ask which address it prints.
    monkeypatch.setattr(server, "_Server", lambda **_: SimpleNamespace(get_port=lambda: 8080))
    _, url = start_server("127.0.0.1", 0, token=token)
    gate, path = Gate(None, token), url.removeprefix("http://127.0.0.1:8080")
    assert url.isascii()
    assert gate.refusal(Headers(HERE), path) is None
    cookie = gate.welcome_cookie(Headers(HERE))
    assert cookie is not None
    back = {"Cookie": cookie.split("; HttpOnly")[0]}
    assert gate.refusal(Headers({**HERE, **back}), "/") is None
    assert gate.refusal(Headers(HERE), f"{path}x") is not None


@pytest.mark.parametrize(
    ("host", "alone"),
    [("127.0.0.1", True), ("127.9.9.9", True), ("::1", True), ("0.0.0.0", False), ("box", False)],
)
def test_loopback(host: str, alone: bool) -> None:
    assert is_loopback(host) is alone


def test_a_running_server(capsys: pytest.CaptureFixture[str]) -> None:
    server, url = start_server("127.0.0.1", 0)
    try:
        page = _get(url)
        assert "/asdfviz/app.js" in page
        assert "/asdfviz/app.css" in page
        assert "viserMutable" in _get(f"{url}asdfviz/app.js")
        # The timeline's script needs what the other one makes.
        assert page.index("/asdfviz/app.js") < page.index("/asdfviz/timeline.js")
        assert "tl-strip" in _get(f"{url}asdfviz/timeline.js")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            _get(url, Host="evil.example")
        socket_url = url.replace("http", "ws")
        with pytest.raises(InvalidStatus, match="403"):
            connect(socket_url, origin="http://evil.example")  # pyright: ignore[reportArgumentType]
        assert server.request_share_url() is None
    finally:
        stop_server(server)
    assert capsys.readouterr().out == ""


def test_a_busy_port_is_an_error_with_a_hint() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} is in use.*--port {port + 1}"):
            start_server("127.0.0.1", port)


@pytest.mark.parametrize("port", [-1, 65536, 99999])
def test_a_port_that_there_is_not_is_an_error(port: int) -> None:
    with pytest.raises(InputError, match=f"there is no port {port}: take one from 1024 to 65535"):
        start_server("127.0.0.1", port)


@pytest.mark.parametrize("host", ["192.0.2.1", "ü..x", "a\0b"])
def test_a_foreign_address_is_an_error(host: str) -> None:
    with pytest.raises(InputError, match="cannot listen on"):
        start_server(host, 0)


def test_beyond_this_machine_there_is_a_token() -> None:
    server, url = start_server("0.0.0.0", 0)
    try:
        assert "?token=" in url
        with pytest.raises(urllib.error.HTTPError, match="401"):
            _get(url.split("?")[0])
        assert "/asdfviz/app.js" in _get(url)
    finally:
        stop_server(server)


def _get(url: str, **headers: str) -> str:
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=10) as page:
        return page.read().decode()


def test_the_address_for_other_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_ELSEWHERE", dict.fromkeys(server._ELSEWHERE, "127.0.0.2"))
    url = "http://127.0.0.1:8080/?token=x"
    assert outside_url(url, "127.0.0.1") is None
    found = outside_url(url, "0.0.0.0")
    assert found is not None
    assert found.startswith("http://127.0.0.")
    assert found.endswith(":8080/?token=x")
