"""Chromium without a window, for tests of pages: driven by its debugging protocol, over pipes."""

import json
import os
import shutil
import subprocess
import time
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
PATIENCE = 30.0
"""The longest wait for something on a page, on a busy machine [s]."""


class Browser:
    """A browser with one page; a context manager.

    Args:
        profile: a folder for what it keeps.
        size: of the page, width and height [px].
    """

    def __init__(self, profile: Path, size: tuple[int, int] = (1280, 800)) -> None:
        ours, its = os.pipe(), os.pipe()
        ends = f"3<&{ours[0]} 4>&{its[1]}"
        options = "--headless --no-sandbox --disable-gpu --remote-debugging-pipe --no-first-run"
        command = f'exec "$0" {options} --user-data-dir="$1" about:blank {ends} 2>/dev/null'
        self._process = subprocess.Popen(
            ["bash", "-c", command, str(CHROMIUM), str(profile)], pass_fds=(ours[0], its[1])
        )
        os.close(ours[0])
        os.close(its[1])
        self._out, self._in = os.fdopen(ours[1], "wb"), os.fdopen(its[0], "rb")
        self._number, self._session, self._rest = 0, "", b""
        (page,) = [
            each
            for each in self._call("Target.getTargets")["targetInfos"]
            if each["type"] == "page"
        ]
        attached = self._call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        self._call("Page.enable")
        self.resize(*size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._out.close()
        self._in.close()
        self._process.terminate()
        self._process.wait(PATIENCE)

    def resize(self, width: int, height: int, scheme: str = "light") -> None:
        """Change the size of the page [px], and whether light or dark is preferred."""
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self._call("Emulation.setEmulatedMedia", features=features)

    def open(self, url: str) -> None:
        """Go to an address."""
        self._call("Page.navigate", url=url)

    def value(self, expression: str) -> Any:
        """The value of an expression of JavaScript on the page."""
        found = self._call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str, is_so: Callable[[Any], bool] = bool) -> Any:
        """The value of an expression, once it is as wanted."""
        ends = time.monotonic() + PATIENCE
        while not is_so(value := self.value(expression)):
            assert time.monotonic() < ends, f"{expression} is {value!r}"
            time.sleep(0.05)
        return value

    def click(self, selector: str) -> None:
        """Press and release the mouse in the middle of an element."""
        node = f"document.querySelector({json.dumps(selector)})"
        at = json.loads(self.value(f"JSON.stringify({node}.getBoundingClientRect())"))
        x, y = at["x"] + at["width"] / 2, at["y"] + at["height"] / 2
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Send an event of the mouse."""
        event = {"button": "left", "buttons": 1, "clickCount": 1, **more}
        self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **event)

    def screenshot(self, path: Path) -> None:
        """Write what is seen, as PNG."""
        path.write_bytes(b64decode(self._call("Page.captureScreenshot")["data"]))

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        call = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            call["sessionId"] = self._session
        self._out.write(json.dumps(call).encode() + b"\0")
        self._out.flush()
        while True:
            while b"\0" not in self._rest:
                part = os.read(self._in.fileno(), 1 << 16)
                assert part, "the browser has ended"
                self._rest += part
            line, self._rest = self._rest.split(b"\0", 1)
            answer = json.loads(line)
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return dict(answer["result"])
