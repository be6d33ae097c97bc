"""Shows files of rerun in a window, in a browser, or as a picture without a screen."""

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from subprocess import DEVNULL, Popen
from tempfile import TemporaryFile
from typing import IO, Any
from urllib.error import URLError
from urllib.parse import quote
from urllib.request import ProxyHandler, build_opener

from contactfusion.errors import ContactFusionError, missing_extra
from contactfusion.files import write_whole
from contactfusion.terminal import say
from contactfusion.view.recorder import TIMELINE, require_recording

HOST = "127.0.0.1"
LOCAL = ("--bind", HOST)
"""Only this machine can connect."""
NOWHERE = f"http://{HOST}:9"
"""No server listens there."""
POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    f"connect-src 'self' data: blob: http://{HOST}:*"
)
"""What a browser may load. In a browser rerun's analytics have no switch: it must not send them."""
WINDOW = "1600x900"
"""The size of a picture [pixels]."""
PATIENCE = 120.0
"""Timeout for the viewer to start and to load a file [s]."""
SETTLING = 1.0
"""Time for which a complete picture stays the same [s]."""
PAUSE = 0.2
"""Pause between two requests [s]."""
NO_DRIVER = "No graphics adapter was found"
"""Message of rerun where no graphics driver is installed."""


def show(rrd: Path, web: bool = False) -> None:
    """Open a file in the viewer, and wait until it is closed.

    Args:
        rrd: the file.
        web: serve the viewer for a browser on this machine, in place of a window.

    Raises:
        ContactFusionError: there is no such file, there is no screen, or the viewer fails.
        DependencyError: rerun is not installed.
    """
    require_recording(rrd)
    if web:
        serve(rrd)
        return
    require_screen()
    command = [program(), str(rrd), *LOCAL, "--port", "auto"]
    if subprocess.run(command, env=quiet_environment()).returncode != 0:
        raise ContactFusionError(f"rerun's viewer could not show {rrd}; it says above why")


def require_screen() -> None:
    """Make sure that a window can be opened.

    Raises:
        ContactFusionError: there is no screen.
    """
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        raise ContactFusionError(
            "there is no screen to open a window on: `contactfusion view` shows it in a browser "
            "(--web), takes a picture (--screenshot FILE.png), or keeps what is drawn for a "
            "machine with a screen (--save FILE.rrd)"
        )


def serve(rrd: Path) -> None:
    """Serve a file until Ctrl+C.

    Raises:
        ContactFusionError: rerun cannot serve it.
        DependencyError: rerun is not installed.
    """
    page, data = _free_port(), _free_port()
    command = [program(), str(rrd), *LOCAL, "--port", str(data)]
    command += ["--serve-web", "--web-viewer-port", str(page)]
    environment = {**quiet_environment(), "RUST_LOG": "error"}
    with subprocess.Popen(command, env=environment) as process, _guarded(page) as server:
        source = quote(f"rerun+http://{HOST}:{data}/proxy", safe="")
        address = f"http://{HOST}:{server.server_port}/?url={source}&theme=dark"
        say(f"open {address} - Ctrl+C ends")
        try:
            while process.poll() is None:
                server.handle_request()
        except KeyboardInterrupt:
            return
        finally:
            process.terminate()
    raise ContactFusionError(f"rerun cannot serve {rrd}; it says above why")


def _guarded(page: int) -> ThreadingHTTPServer:
    """A server of the page on a port, with the policy; it waits half a second at a time."""
    direct = build_opener(ProxyHandler({}))

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = self.headers.get("Host", "").rpartition(":")[0]
            if name not in (HOST, "localhost"):  # a page of another name may read what it answers
                self.send_error(403, "ask for it by the name localhost")
                return
            try:
                with direct.open(f"http://{HOST}:{page}{self.path}") as answer:
                    self.send_response(answer.status)
                    for name in ("Content-Type", "Content-Encoding", "Content-Length"):
                        if name in answer.headers:
                            self.send_header(name, answer.headers[name])
                    self.send_header("Content-Security-Policy", POLICY)
                    self.end_headers()
                    shutil.copyfileobj(answer, self.wfile)
            except URLError as error:
                self.send_error(502, str(error))

        def log_message(self, format: str, *args: object) -> None:
            return

    server = ThreadingHTTPServer((HOST, 0), Page)
    server.timeout = 0.5
    return server


def screenshot(rrd: Path, png: Path, at: float | None = None) -> None:
    """Write the viewer's first view as a picture.

    Args:
        rrd: the file.
        png: the picture to write.
        at: the moment [s]; None, or one after the end: the last.

    Raises:
        ContactFusionError: there is no such file, it is no recording, or nothing can draw it.
        DependencyError: rerun is not installed.
    """
    require_recording(rrd)
    with _unseen_viewer(rrd) as (client, end):
        moment = end if at is None else at
        _patiently(lambda: client.set_time(TIMELINE, duration=moment, play_state="paused"))
        picture = _settled(client)
    write_whole(png, picture)


def _settled(client: Any) -> bytes:
    """The first picture that equals the one before: the viewer loads piece by piece."""
    latest, before = time.monotonic() + PATIENCE, b""
    while time.monotonic() < latest:
        picture: bytes = _patiently(client.take_screenshot)
        if picture == before:
            return picture
        before = picture
        time.sleep(SETTLING)
    return before


def _patiently(request: Callable[[], Any]) -> Any:
    """Repeat a request while the viewer is too busy: without a graphics card it is slow."""
    latest = time.monotonic() + PATIENCE
    while time.monotonic() < latest:
        try:
            return request()
        except TimeoutError:
            time.sleep(PAUSE)
    raise ContactFusionError(f"rerun's viewer did not answer for {PATIENCE:.0f} s")


@contextmanager
def _unseen_viewer(rrd: Path) -> Iterator[tuple[Any, float]]:
    """Run the viewer without a window: its client, and the last stamp [s]."""
    port = _free_port()
    command = [program(), str(rrd), *LOCAL, "--port", str(port), "--headless"]
    command += ["--window-size", WINDOW, "--renderer", "vulkan"]
    # else its own messages stand in the picture
    environment = {**quiet_environment(), "RUST_LOG": "off"}
    with (
        TemporaryFile("w+") as errors,
        Popen(command, env=environment, stdout=DEVNULL, stderr=errors) as process,
    ):
        try:
            yield _loaded(process, errors, port)
        finally:
            process.terminate()


def _loaded(process: Popen[bytes], errors: IO[str], port: int) -> tuple[Any, float]:
    """The client of a viewer that has loaded its file, and the last stamp [s]."""
    from rerun.experimental import ViewerClient

    latest = time.monotonic() + PATIENCE
    while time.monotonic() < latest:
        if process.poll() is not None:
            errors.seek(0)
            raise ContactFusionError(_failure(errors.read()))
        time.sleep(PAUSE)
        try:
            client = ViewerClient.connect(f"rerun+http://{HOST}:{port}/proxy")
            state = client.get_state()
        except (OSError, RuntimeError):
            continue  # it is still starting
        times = [line for recording in state.recordings for line in recording.timelines]
        ends = [line.end for line in times if line.name == TIMELINE and line.end is not None]
        if ends and not state.loading:
            return client, max(ends) / 1e9
    raise ContactFusionError(f"rerun's viewer had not loaded the file after {PATIENCE:.0f} s")


def _failure(errors: str) -> str:
    """The reason why the viewer ended."""
    if NO_DRIVER in errors:
        return (
            "nothing here can draw a picture: install a Vulkan driver with "
            "'apt install mesa-vulkan-drivers libvulkan1'"
        )
    lines = [line for line in errors.splitlines() if line.strip()]
    return f"rerun's viewer failed: {lines[0] if lines else 'it does not say why'}"


def program() -> str:
    """The program that shows files of rerun; it comes with the library.

    Raises:
        DependencyError: it is not installed.
    """
    try:
        import rerun_cli
    except ImportError:
        raise missing_extra("rerun-sdk", "view") from None
    suffix = ".exe" if sys.platform.startswith("win") else ""
    return str(Path(str(rerun_cli.__file__)).with_name(f"rerun{suffix}"))


def quiet_environment() -> dict[str, str]:
    """The environment in which the program sends no analytics.

    Its analytics are off where `CI` is set, so that nothing need be written to the user's home.
    Its other requests to the internet, such as for its newest version, are refused by a proxy.
    """
    environment = {**os.environ, "CI": "1", "HTTPS_PROXY": NOWHERE, "https_proxy": NOWHERE}
    environment.pop("FORCE_RERUN_ANALYTICS", None)
    return environment


def _free_port() -> int:
    """A free port of this machine."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port
