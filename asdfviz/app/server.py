"""Starts viser's server so that only this machine's own pages reach it, and serves our script and style.

viser itself listens everywhere, checks neither Host nor Origin, moves on silently from a busy port
and opens a public tunnel when any client asks. Here all four are closed before the first request.
"""

from __future__ import annotations

import contextlib
import functools
import gzip
import hashlib
import hmac
import http
import io
import ipaddress
import secrets
import socket
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlsplit

import viser
import websockets.asyncio.server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from asdfviz.errors import InputError

_COOKIE = "asdfviz_token"
STATIC = Path(__file__).parent / "static"
ASSETS = {
    "/asdfviz/app.js": "application/javascript; charset=utf-8",
    "/asdfviz/timeline.js": "application/javascript; charset=utf-8",
    "/asdfviz/typing.js": "application/javascript; charset=utf-8",
    "/asdfviz/app.css": "text/css; charset=utf-8",
}
_HEAD = (
    b'<link rel="stylesheet" href="/asdfviz/app.css">'
    b'<script src="/asdfviz/app.js" defer></script>'
    b'<script src="/asdfviz/timeline.js" defer></script>'
    b'<script src="/asdfviz/typing.js" defer></script></head>'
)
LAST_PORT = 65535
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_EVERYWHERE = ("0.0.0.0", "::")
_ELSEWHERE = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}
"""Addresses that are nobody's, kept for documents."""
_ANY_BYTES = "surrogateescape"
"""How text holds bytes that are no UTF-8; headers and the command line come so."""
_Handler = Callable[[ServerConnection, Request], Response | None]


@dataclass(frozen=True, slots=True)
class Gate:
    """Who may come in."""

    hosts: frozenset[str] | None
    """Names that the Host header may carry; None leaves it to the token."""
    token: str | None
    """Secret of a server that listens beyond this machine."""

    def refusal(self, headers: Headers, path: str) -> tuple[int, str] | None:
        """Say with which status and reason a request is refused; None lets it in.

        A foreign Host is DNS rebinding, a foreign Origin is another site's script: both are 403.
        """
        host = headers.get("Host", "")
        if self.hosts is not None and urlsplit(f"//{host}").hostname not in self.hosts:
            return 403, "This address is not served here."
        upgrade = is_websocket(headers)
        if upgrade and urlsplit(headers.get("Origin", "")).netloc != host:
            return 403, "Only the app's own page may connect."
        if self.token is None or self._knows(headers, self.token):
            return None
        if not upgrade and _same(_query_token(path), self.token):
            return None
        return 401, "Open the address that asdfviz printed: it carries the token."

    def welcome_cookie(self, headers: Headers) -> str | None:
        """The Set-Cookie value that a first visit with the right token gets."""
        if self.token is None or self._knows(headers, self.token):
            return None
        return (
            f"{_cookie_name(self.token)}={_quoted(self.token)}; HttpOnly; SameSite=Strict; Path=/"
        )

    @staticmethod
    def _knows(headers: Headers, token: str) -> bool:
        """Whether a request brings our cookie, whatever other programs of this host have set."""
        pairs = ";".join(headers.get_all("Cookie")).split(";")
        ours = f"{_cookie_name(token)}="
        values = (
            pair.strip().removeprefix(ours) for pair in pairs if pair.strip().startswith(ours)
        )
        return any(_same(unquote(value, errors=_ANY_BYTES), token) for value in values)


def is_websocket(headers: Headers) -> bool:
    """Whether a request asks to become a web socket."""
    return headers.get("Upgrade", "").lower() == "websocket"


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    if host in _LOOPBACK:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def start_server(host: str, port: int, *, token: str | None = None) -> tuple[Any, str]:
    """Start a guarded viser server.

    Args:
        host: address to listen on; beyond this machine a token is made where none is given.
        port: 0 takes any free one.
        token: secret that the first request has to carry.

    Returns:
        The viser.ViserServer and the address to open, token included.

    Raises:
        InputError: there is no such port, it is taken, or the address is not one of this machine's.
    """
    check_free(host, port)
    wide = not is_loopback(host)
    token = token or (secrets.token_urlsafe(16) if wide else None)
    gate = Gate(None if wide else frozenset({*_LOOPBACK, host}), token)
    # viser prints a banner whatever `verbose` says; the command line says where the app is.
    with _guarded(gate), contextlib.redirect_stdout(io.StringIO()):
        server = _Server(host=host, port=port, verbose=False)
    bound = server.get_port()
    if port not in (0, bound):
        stop_server(server)
        raise _busy(port)
    shown = "127.0.0.1" if host in _EVERYWHERE else host
    shown = f"[{shown}]" if ":" in shown else shown
    return server, f"http://{shown}:{bound}/" + (f"?token={_quoted(token)}" if token else "")


def outside_url(url: str, host: str) -> str | None:
    """The address that other machines open where the app listens on all of this one's; else None."""
    if host not in _EVERYWHERE:
        return None
    family = socket.AF_INET if host == "0.0.0.0" else socket.AF_INET6
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        # Nothing is sent: this only asks which of the machine's addresses would be used.
        probe.connect((_ELSEWHERE[family], 9))
        own = str(probe.getsockname()[0])
        return url.replace("127.0.0.1", f"[{own}]" if ":" in own else own, 1)
    return None


def stop_server(server: viser.ViserServer) -> None:
    """Stop a server without its farewell on stdout."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def check_free(host: str, port: int) -> None:
    """Try the address, before anything is opened or written for it.

    Raises:
        InputError: there is no such port, it is taken, or the address is not one of this machine's.
    """
    if not 0 <= port <= LAST_PORT:
        raise InputError(
            f"there is no port {port}: take one from 1024 to {LAST_PORT}, or 0 for any"
        )
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except PermissionError as error:
            raise InputError(f"port {port} needs more rights: take one above 1023") from error
        except OSError as error:
            if isinstance(error, socket.gaierror) or error.errno not in (98, 48, 10048):
                raise InputError(f"cannot listen on '{host}': {error.strerror or error}") from error
            raise _busy(port) from error
        except TypeError as error:  # what Python cannot even encode as a host's name
            raise InputError(f"cannot listen on {host!r}: no host can have that name") from error


class _Server(viser.ViserServer):
    def request_share_url(self, verbose: bool = True) -> str | None:
        """Never open viser's public tunnel, which any client may ask for."""
        del verbose
        return None


def _busy(port: int) -> InputError:
    return InputError(
        f"port {port} is in use, perhaps by asdfviz in another window: "
        f"close that one or take another port, for example --port {port + 1}"
    )


@contextlib.contextmanager
def _guarded(gate: Gate) -> Generator[None]:
    """Put the gate before viser's own request handler while its server starts."""
    original = websocket_server.serve

    def serve(*args: Any, process_request: _Handler | None = None, **options: Any) -> Any:
        inner = process_request or _pass_on
        handler = functools.partial(_answer, gate, inner)
        return original(*args, process_request=handler, **options)

    websocket_server.serve = serve
    try:
        yield
    finally:
        websocket_server.serve = original


def _pass_on(connection: ServerConnection, request: Request) -> Response | None:
    del connection, request
    return None


def _answer(
    gate: Gate, inner: _Handler, connection: ServerConnection, request: Request
) -> Response | None:
    refusal = gate.refusal(request.headers, request.path)
    if refusal is not None:
        status, reason = refusal
        return Response(status, http.HTTPStatus(status).phrase, Headers(), reason.encode())
    path = urlsplit(request.path).path
    if path in ASSETS:
        response = _asset(path)
    else:
        response = inner(connection, request)
        if response is not None and path in ("/", "/index.html"):
            response = _with_our_files(response)
    cookie = gate.welcome_cookie(request.headers)
    if response is not None and cookie is not None:
        response.headers["Set-Cookie"] = cookie
    return response


def _asset(path: str) -> Response:
    body = (STATIC / Path(path).name).read_bytes()
    headers = {"Content-Type": ASSETS[path], "Content-Length": str(len(body))}
    return Response(200, "OK", Headers({**headers, "Cache-Control": "no-cache"}), body)


def _with_our_files(response: Response) -> Response:
    """Let viser's page load our style and script."""
    packed = response.headers.get("Content-Encoding") == "gzip"
    body = _page(bytes(response.body or b""), packed=packed)
    headers = Headers(response.headers)
    del headers["Content-Length"]
    headers["Content-Length"] = str(len(body))
    headers["Cache-Control"] = "no-cache"
    return Response(response.status_code, response.reason_phrase, headers, body)


@functools.lru_cache(maxsize=2)
def _page(body: bytes, *, packed: bool) -> bytes:
    page = gzip.decompress(body) if packed else body
    page = page.replace(b"</head>", _HEAD, 1)
    return gzip.compress(page) if packed else page


def _cookie_name(token: str) -> str:
    """Browsers share the cookies of a host between its ports, so every token has its own."""
    return f"{_COOKIE}_{hashlib.sha256(token.encode(errors=_ANY_BYTES)).hexdigest()[:8]}"


def _query_token(path: str) -> str:
    return parse_qs(urlsplit(path).query, errors=_ANY_BYTES).get("token", [""])[0]


def _quoted(token: str) -> str:
    """A token as addresses and cookies carry it: a person's own may hold any character."""
    return quote(token, safe="", errors=_ANY_BYTES)


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(errors=_ANY_BYTES), token.encode(errors=_ANY_BYTES))
