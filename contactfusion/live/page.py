"""The page of `contactfusion live --web`: what runs, seen and changed in a browser."""

import base64
import contextlib
import hashlib
import ipaddress
import json
import re
import secrets
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, NamedTuple, Self, final
from urllib.parse import parse_qs

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, ContactFusionError

LOOPBACK = "127.0.0.1"
PERIOD = 0.05
"""The time between two looks for a new status [s]."""
ALIVE = 1.0
"""The longest silence on a stream, so that one whose client is gone ends [s]."""
CLIENTS = 8
"""The most pages that are open at a time."""
CONNECTIONS = 32
"""The most connections at a time; further ones are closed."""
PATIENCE = 5.0
"""The longest wait for a client to send its request, or to take something [s]."""
LONGEST = 1000
"""The longest order [bytes]."""
DIGITS = 16
"""A number of more digits is larger than any length."""
DRAINED = 65536
"""So much of a too long order is read, so that its client hears why it is refused [bytes]."""
ORDER = re.compile(r"tare .+|record (start|stop)")
"""What the page may order; `ctl`, which only this user can reach, may load code and name files."""


class Address(NamedTuple):
    """Where the page is served."""

    host: str
    port: int

    @classmethod
    def of(cls, text: str) -> Self:
        """The address in text, such as "8080", "0.0.0.0:8080" or "[::1]:8080".

        Raises:
            ConfigurationError: it holds none.
        """
        host, _, port = text.rpartition(":")
        if not (port.isascii() and port.isdecimal() and int(port) < 2**16):
            raise ConfigurationError(f"'{text}' is no [HOST:]PORT, such as 8080", "--web")
        return cls(host.strip("[]") or LOOPBACK, int(port))


@final
class Page(socketserver.ThreadingTCPServer):
    """Serves the page, in threads of its own; a context manager.

    On an address of the loopback interface, all who are on this machine may see it; a request must
    name that interface, so that no site makes a browser ask for it by a name of its own. On any
    other address it takes a token, which the link brings and a cookie keeps.

    Args:
        host: name or address to listen at.
        port: to listen at; 0: any that is free.
        status: the mapping of `Status.fields`, a new one when something changed.
        surface: a version, and points of the robot's surface, shape (n, 3) [m].
        change: carries out an order such as "tare skin"; a sentence on what was done.

    Attributes:
        url: the link, with the token where there is one.

    Raises:
        ConfigurationError: it can't be served there.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(
        self,
        host: str,
        port: int,
        status: Callable[[], Mapping[str, Any]],
        surface: Callable[[], tuple[int, FloatArray]],
        change: Callable[[str], str],
    ) -> None:
        self.status, self.surface, self.change = status, surface, change
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            self.address_family, *_, address = found[0]
            bound = str(address[0])
            super().__init__((bound, port), _Handler)
        except OSError as error:
            problem = f"the page can't be served at {host}:{port}: {error.strerror}"
            raise ConfigurationError(problem, "--web") from None
        except UnicodeError:
            raise ConfigurationError(f"'{host}' is no name of a host", "--web") from None
        interface = ipaddress.ip_address(bound)
        shown = socket.gethostname() if interface.is_unspecified else host
        shown = f"[{shown}]" if ":" in shown else shown
        self.token = "" if interface.is_loopback else secrets.token_urlsafe(16)
        self.cookie = f"contactfusion-{self.server_address[1]}={self.token}"
        self.names = {LOOPBACK, "localhost", "[::1]", shown.lower()}
        query = f"?token={self.token}" if self.token else ""
        self.url = f"http://{shown}:{self.server_address[1]}/{query}"
        self.clients = threading.BoundedSemaphore(CLIENTS)
        self.ended = threading.Event()
        self._free = threading.BoundedSemaphore(CONNECTIONS)
        self._thread = threading.Thread(
            target=self.serve_forever, args=(0.1,), name="page", daemon=True
        )

    def __enter__(self) -> Self:
        """Begin to serve."""
        self._thread.start()
        return self

    def __exit__(self, *raised: object) -> None:
        """End all streams, and serve no more."""
        self.ended.set()
        self.shutdown()
        self._thread.join()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread, if there are not too many."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, in a thread."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()


def _hashed(html: str, tag: str) -> str:
    """The source of a policy that allows what stands in the only element of this tag."""
    text = html.partition(f"<{tag}>")[2].partition(f"</{tag}>")[0]
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


HTML = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; connect-src 'self'; img-src data:; "
    f"script-src {_hashed(HTML, 'script')}; style-src {_hashed(HTML, 'style')}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


@final
class _Handler(BaseHTTPRequestHandler):
    """Answers a request."""

    server_version, sys_version = "contactfusion", ""

    def setup(self) -> None:
        super().setup()
        self.connection.settimeout(PATIENCE)
        assert isinstance(self.server, Page)
        self.page = self.server

    def handle(self) -> None:
        late = threading.Timer(PATIENCE, self._stop_reading)
        late.daemon = True
        late.start()
        with contextlib.suppress(OSError):  # the client is gone, or too slow
            super().handle()
        late.cancel()

    def _stop_reading(self) -> None:
        """End a request that is not here yet; what is sent goes on."""
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RD)

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing: the terminal is for events."""

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if not self._admits():
            return
        if path == "/":
            self._answer(200, HTML.encode(), "text/html; charset=utf-8")
        elif path == "/status":
            self._stream()
        elif path == "/surface":
            points = np.asarray(self.page.surface()[1], "<f4")
            self._answer(200, points.tobytes(), "application/octet-stream")
        else:
            self._answer(404, "there is nothing here")

    def do_POST(self) -> None:
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal()):
            self._answer(411, "an order has a length")
            return
        size = int(length) if len(length) < DIGITS else DRAINED + LONGEST
        body = self.rfile.read(min(size, DRAINED))
        if not self._admits():
            return
        order = body.decode(errors="replace").strip()
        if self.path != "/change":
            self._answer(404, "there is nothing here")
        elif size > LONGEST:
            self._answer(413, f"an order is at most {LONGEST} bytes long")
        elif not ORDER.fullmatch(order):
            self._answer(403, "the page takes a tare, and begins and ends recordings")
        else:
            try:
                self._answer(200, self.page.change(order))
            except ContactFusionError as error:
                self._answer(409, str(error))

    def _admits(self) -> bool:
        """Whether the request may be answered; answers it otherwise."""
        host = self.headers.get("Host", "")
        ours = f"http://{host}"
        lacking = ours if self.command == "GET" else ""  # a browser names it in each POST
        if self.headers.get("Origin", lacking) != ours:
            self._answer(403, "another site asked for it")
        elif self.page.token and not self._has_token():
            self._answer(403, "open the link with the token, which `contactfusion live` printed")
        elif not self.page.token and re.sub(r":\d+$", "", host).lower() not in self.page.names:
            self._answer(403, "ask for it by the name localhost")
        else:
            return True
        return False

    def _has_token(self) -> bool:
        token, cookie = self.page.token, self.page.cookie
        given = parse_qs(self.path.partition("?")[2]).get("token", [""])[0]
        cookies = [part.strip() for part in self.headers.get("Cookie", "").split(";")]
        return secrets.compare_digest(given.encode(), token.encode()) or any(
            [secrets.compare_digest(each.encode(), cookie.encode()) for each in cookies]
        )

    def _stream(self) -> None:
        """Send each new status, until the client is gone."""
        if not self.page.clients.acquire(blocking=False):
            self._answer(503, f"{CLIENTS} pages are open already")
            return
        try:
            self._begin(200, "text/event-stream")
            self.wfile.write(b"retry: 1000\n\n")
            known, sent = None, time.monotonic()
            while not self.page.ended.wait(PERIOD):
                status = self.page.status()
                now = time.monotonic()
                if status and status is not known:
                    known, sent = status, now
                    self.wfile.write(f"data: {json.dumps(status)}\n\n".encode())
                elif now - sent > ALIVE:
                    sent = now
                    self.wfile.write(b":\n\n")
        finally:
            self.page.clients.release()

    def _answer(
        self, code: int, body: str | bytes, kind: str = "text/plain; charset=utf-8"
    ) -> None:
        content = body.encode() if isinstance(body, str) else body
        self._begin(code, kind, {"Content-Length": str(len(content))})
        self.wfile.write(content)

    def _begin(self, code: int, kind: str, more: Mapping[str, str] | None = None) -> None:
        self.send_response(code)
        for name, value in {**HEADERS, "Content-Type": kind, **(more or {})}.items():
            self.send_header(name, value)
        if code == 200 and self.page.token:
            cookie = f"{self.page.cookie}; HttpOnly; SameSite=Lax; Path=/"
            self.send_header("Set-Cookie", cookie)
        self.end_headers()
