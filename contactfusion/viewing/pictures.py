"""Takes pictures of files of rerun, without a screen."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import DEVNULL, Popen
from tempfile import TemporaryFile
from typing import IO, Any

from contactfusion.errors import ContactFusionError
from contactfusion.files import write_whole
from contactfusion.viewing.library import LOCAL, free_port, program, quiet_environment
from contactfusion.viewing.recorder import TIMELINE
from contactfusion.viewing.showing import require_recording

WINDOW = "1600x900"
"""The size of a picture [pixels]."""
PATIENCE = 120.0
"""So long the viewer may take to start and to load a file [s]."""
SETTLING = 1.0
"""A picture that stays the same for so long is complete [s]."""
PAUSE = 0.2
"""So long is waited before it is asked again [s]."""
NO_DRIVER = "No graphics adapter was found"
"""What rerun says where nothing can draw."""


def screenshot(rrd: Path, png: Path, at: float | None = None) -> None:
    """Take a picture of what the viewer shows first.

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
    """Take pictures until one is like the one before: what is shown is fetched bit by bit."""
    latest, before = time.monotonic() + PATIENCE, b""
    while time.monotonic() < latest:
        picture: bytes = _patiently(client.take_screenshot)
        if picture == before:
            return picture
        before = picture
        time.sleep(SETTLING)
    return before


def _patiently(ask: Callable[[], Any]) -> Any:
    """Ask the viewer again while it is too busy to answer: without a graphics card it is slow."""
    latest = time.monotonic() + PATIENCE
    while time.monotonic() < latest:
        try:
            return ask()
        except TimeoutError:
            time.sleep(PAUSE)
    raise ContactFusionError(f"rerun's viewer did not answer for {PATIENCE:.0f} s")


@contextmanager
def _unseen_viewer(rrd: Path) -> Iterator[tuple[Any, float]]:
    """Run the viewer without a window; give what steers it, and the last moment [s]."""
    port = free_port()
    command = [program(), str(rrd), *LOCAL, "--port", str(port), "--headless"]
    command += ["--window-size", WINDOW, "--renderer", "vulkan"]
    # else its own messages stand in the picture
    environment = {**quiet_environment(), "RUST_LOG": "off"}
    with (
        TemporaryFile("w+") as said,
        Popen(command, env=environment, stdout=DEVNULL, stderr=said) as process,
    ):
        try:
            yield _loaded(process, said, port)
        finally:
            process.terminate()


def _loaded(process: Popen[bytes], said: IO[str], port: int) -> tuple[Any, float]:
    """Wait until a viewer has loaded its file; give what steers it, and the last moment [s]."""
    from rerun.experimental import ViewerClient

    latest = time.monotonic() + PATIENCE
    while time.monotonic() < latest:
        if process.poll() is not None:
            said.seek(0)
            raise ContactFusionError(_failure(said.read()))
        time.sleep(PAUSE)
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            state = client.get_state()
        except (OSError, RuntimeError):
            continue  # it is still starting
        times = [line for one in state.recordings for line in one.timelines]
        ends = [line.end for line in times if line.name == TIMELINE and line.end is not None]
        if ends and not state.loading:
            return client, max(ends) / 1e9
    raise ContactFusionError(f"rerun's viewer had not loaded the file after {PATIENCE:.0f} s")


def _failure(said: str) -> str:
    """Say why the viewer ended."""
    if NO_DRIVER in said:
        return (
            "nothing here can draw a picture: install a Vulkan driver with "
            "'apt install mesa-vulkan-drivers libvulkan1'"
        )
    lines = [line for line in said.splitlines() if line.strip()]
    return f"rerun's viewer failed: {lines[0] if lines else 'it does not say why'}"
