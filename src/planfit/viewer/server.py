"""A small HTTP server on 127.0.0.1: the report with its panel of corrections, behind a token.

Nothing but this machine reaches it; and of this machine, only who has the address: other users and pages of
other origins in the same browser have not. What it is asked to do it does to one file, OUT/corrections.toml,
and by one solve at a time.
"""

import errno
import hmac
import json
import math
import re
import secrets
import sys
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, TypeVar

from planfit.errors import OptionError, PlanfitError, printable
from planfit.runtime import whole_number
from planfit.units import told_in
from planfit.viewer.session import Session, as_json, report_page

Value = TypeVar("Value")
HOST = "127.0.0.1"
MAX_BODY = 1_000_000
MAX_DIGITS = 18
SCRIPTS = ("pick.js", "plan_map.js", "drag.js", "cloud.js", "panel.js")
_POLICY = (
    "default-src 'none'; img-src 'self' data: blob:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'"
)


class ViewServer(ThreadingHTTPServer):
    """Serves a session until `shutdown`."""

    daemon_threads = True
    # Windows lets two servers take one port where this is set.
    allow_reuse_address = False

    def __init__(self, session: Session, port: int = 0) -> None:
        """Bind at once; port 0 takes one that is free.

        Raises:
            OptionError: the port is taken, or may not be used.
        """
        self.session = session
        self.token = secrets.token_urlsafe(24)
        try:
            super().__init__((HOST, port), _Handler)
        except OverflowError as error:
            raise OptionError(f"--port: expected 0 to 65535, found {port}") from error
        except OSError as error:
            why = "one in use" if error.errno == errno.EADDRINUSE else f"{error.strerror}"
            raise OptionError(
                f"--port: expected a free port, found {why} at {port}; choose another, or leave it out"
            ) from error

    @property
    def address(self) -> str:
        """Of the page, with its token."""
        return f"http://{HOST}:{self.server_address[1]}/{self.token}/"

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own, which knows the units of the session."""
        with told_in(self.session.units):
            super().process_request_thread(request, client_address)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Who went away before the answer was written is no error of the server."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: ViewServer  # type: ignore[assignment]
    protocol_version = "HTTP/1.1"
    # A connection that says nothing is not waited for.
    timeout = 60

    def log_message(self, format: str, *args: object) -> None:
        """Nothing is printed by a library."""

    def do_GET(self) -> None:
        """The page, an image, or the state."""
        session = self.server.session
        path = self._path()
        if path is None:
            return
        name, _, rest = path.partition("/")
        told = {"state": session.state, "plan": session.plan, "shape": session.shape}
        if path == "":
            self._answer(lambda: page(report_page(session.folder)), "text/html; charset=utf-8")
        elif path in told:
            self._answer(lambda: as_json(told[path]()), "application/json")
        elif name == "frame" and (number := whole_number(rest)) is not None:
            self._answer(lambda: session.image(number), "image/jpeg")
        else:
            self._send(404, b"nothing here", "text/plain")

    def do_POST(self) -> None:
        """A correction added or removed, a solve, or what pixel shows a point."""
        path = self._path()
        if path is None:
            return
        session, body = self.server.session, self._body()
        if body is None:
            return
        actions: dict[str, Callable[[], dict[str, Any] | None]] = {
            "add": lambda: session.add(_value(body, "kind", str), _value(body, "entry", dict)),
            "remove": lambda: session.remove(
                _value(body, "kind", str), _value(body, "number", int), _value(body, "words", str)
            ),
            "drag": lambda: session.place_dragged(_tables(body, "pairs")),
            "solve": session.start_solve,
            "pixel": lambda: session.pixel_of(
                _value(body, "frame", int), _numbers(body, "point", 3)
            ),
        }
        if path not in actions:
            self._send(404, b"nothing here", "text/plain")
            return

        def done() -> bytes:
            told = actions[path]()
            return as_json(session.state() if told is None else told)

        self._answer(done, "application/json")

    def _path(self) -> str | None:
        """What is asked for, behind the token; None where it was refused."""
        port = self.server.server_address[1]
        host, origin = self.headers.get("Host"), self.headers.get("Origin")
        token, _, path = re.split("[?#]", self.path)[0].lstrip("/").partition("/")
        is_ours = hmac.compare_digest(token.encode(), self.server.token.encode())
        # A name that leads here from elsewhere (DNS rebinding) stands in Host; a page of elsewhere in Origin,
        # as "null" where it is a file or hides who it is.
        is_here = host in (f"{HOST}:{port}", f"localhost:{port}")
        if is_ours and is_here and origin in (None, f"http://{host}"):
            return path
        self._send(403, b"open the address that planfit view printed", "text/plain")
        return None

    def _body(self) -> dict[str, Any] | None:
        """JSON of a request; None where it was refused."""
        length = whole_number(self.headers.get("Content-Length", ""))
        is_json = self.headers.get("Content-Type", "").split(";")[0] == "application/json"
        if not is_json or length is None or length > MAX_BODY:
            self.close_connection = True
            self._send(400, b"expected JSON of at most 1 MB", "text/plain")
            return None
        try:
            content = json.loads(self.rfile.read(length) or b"{}", parse_int=_integer)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict):
            self._send(400, b"expected a JSON object of numbers below 1e18", "text/plain")
            return None
        return content

    def _answer(self, make: Callable[[], bytes], kind: str) -> None:
        try:
            content = make()
        except PlanfitError as error:
            told = as_json({"error": printable(str(error))})
            self._send(400, told, "application/json")
            return
        self._send(200, content, kind)

    def _send(self, status: int, content: bytes, kind: str) -> None:
        try:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            # With no referrer at all, a browser may call the page's own origin "null".
            self.send_header("Referrer-Policy", "same-origin")
            self.send_header("X-Content-Type-Options", "nosniff")
            if kind.startswith("text/html"):
                self.send_header("Content-Security-Policy", _POLICY)
            self.end_headers()
            self.wfile.write(content)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True  # the page was closed


def page(report: bytes) -> bytes:
    """The report, UTF-8, with the panel of corrections in it, and an empty icon, or the browser asks for one.

    As bytes, joined once: a report of 10 million points has 96 MB, of which text has two bytes a character.
    """
    style, markup = _read("panel.css"), _read("panel.html")
    script = "\n".join(_read(name) for name in SCRIPTS)
    panel = f'<style>\n{style}</style>\n{markup}<script>(() => {{\n"use strict";\n{script}}})();</script>\n'
    whole, body = memoryview(report), report.rfind(b"</body>")
    body = len(report) if body < 0 else body
    start = report.find(b"<head>") + len(b"<head>") if b"<head>" in report else 0
    icon = b'<link rel="icon" href="data:,">' if start else b""
    return b"".join([whole[:start], icon, whole[start:body], panel.encode(), whole[body:]])


def _read(name: str) -> str:
    return resources.files("planfit.viewer").joinpath("page", name).read_text("utf-8")


def _integer(word: str) -> int:
    """A whole number of JSON. One of hundreds of digits counts nothing here, and is no float.

    Raises:
        ValueError: it is longer than any that 64 bits hold.
    """
    if len(word) > MAX_DIGITS:
        raise ValueError(f"a number of {len(word)} digits")
    return int(word)


_KINDS: dict[type, str] = {str: "words", int: "a number", dict: "a table"}


def _value(body: dict[str, Any], key: str, kind: type[Value]) -> Value:
    """One of `_KINDS`."""
    value = body.get(key)
    if not isinstance(value, kind):
        raise OptionError(f"expected {_KINDS[kind]} for {key}, found {type(value).__name__}")
    return value


def _numbers(body: dict[str, Any], key: str, count: int) -> list[float]:
    value = body.get(key)
    values = value if isinstance(value, list) else []
    found = [float(v) for v in values if isinstance(v, int | float) and math.isfinite(v)]
    if len(values) != count or len(found) != count:
        raise OptionError(f"expected {count} numbers for {key}, found {value!r}")
    return found


def _tables(body: dict[str, Any], key: str) -> list[dict[str, Any]]:
    value = body.get(key)
    tables = value if isinstance(value, list) else []
    if not tables or not all(isinstance(each, dict) for each in tables):
        raise OptionError(f"expected tables for {key}, found {value!r}")
    return tables
