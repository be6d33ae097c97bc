"""`contactfusion ctl`: orders to a pipeline that runs, by a socket of this machine and user."""

import contextlib
import errno
import json
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from textwrap import shorten
from typing import final

from contactfusion.errors import ConfigurationError, ContactFusionError, cause_in, name_hint

LONGEST = 65536
"""So much of a line is read at a time; the longest has 64 times as much [bytes]."""
PATIENCE = 10.0
"""The longest wait for an order, or for what came of it [s]."""
SHOWN = 60
"""So much of an order that fails is repeated [characters]."""
SHORTAGE = 0.2
"""The time between two attempts while there are no descriptors, or no memory, for an order [s]."""
SUFFIX = ".sock"


def folder() -> Path:
    """The folder of the sockets, which is this user's alone.

    Raises:
        ConfigurationError: it is another's.
    """
    above = os.environ.get("XDG_RUNTIME_DIR")
    name = "contactfusion" if above else f"contactfusion-{os.getuid()}"
    path = Path(above or tempfile.gettempdir()) / name
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    about = path.lstat()
    if about.st_uid != os.getuid() or about.st_mode & 0o077 or path.is_symlink():
        raise ConfigurationError(f"{path} must be a folder of this user alone (mode 700)")
    return path


@final
class Control:
    """Takes orders in a thread of its own; a context manager.

    Args:
        name: of what runs, as `ctl --name` names it.
        order: carries out an order; a sentence on what was done.

    Raises:
        ConfigurationError: something of this name runs already.
    """

    def __init__(self, name: str, order: Callable[[str], str]) -> None:
        if "/" in name:
            raise ConfigurationError(f"--name {name}: a name holds no slash")
        self._path, self._order = folder() / f"{name}{SUFFIX}", order
        if self._path.exists() and _answers(self._path):
            raise ConfigurationError(f"'{name}' runs already; choose another name by --name")
        self._path.unlink(missing_ok=True)  # left by a process that was killed
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.bind(str(self._path))
        except OSError as error:  # such as a name that is too long
            self._socket.close()
            raise ConfigurationError(f"--name {name}: {self._path}: {error}") from None
        self._socket.listen(8)
        self._thread = threading.Thread(target=self._serve, name="ctl", daemon=True)

    def __enter__(self) -> "Control":
        """Begin to take orders."""
        self._thread.start()
        return self

    def __exit__(self, *raised: object) -> None:
        """Take no more orders."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError as error:
                if error.errno not in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                    return  # closed
                time.sleep(SHORTAGE)
                continue
            with connection, contextlib.suppress(OSError):
                connection.settimeout(PATIENCE)
                self._answer(connection)

    def _answer(self, connection: socket.socket) -> None:
        try:
            answer = {"ok": True, "text": self._done(_line(connection))}
        except ContactFusionError as error:
            answer = {"ok": False, "text": str(error)}
        connection.sendall(json.dumps(answer).encode() + b"\n")

    def _done(self, order: str) -> str:
        try:
            return self._order(order)
        except ContactFusionError:
            raise
        except Exception as error:  # it is for who ordered, and ends no thread
            shown = shorten(order, SHOWN, placeholder=" …")
            cause = cause_in(error, "contactfusion")
            raise ConfigurationError(f"the order '{shown}' failed: {cause}") from error


def ask(order: str, name: str | None = None) -> str:
    """Give an order to what runs; the sentence on what was done.

    Args:
        order: such as "tare wrist".
        name: of what runs; None: the only one.

    Raises:
        ConfigurationError: nothing of this name runs, or several do and none is named, or the order
            is refused.
    """
    running = sorted(path for path in folder().glob(f"*{SUFFIX}") if _answers(path))
    names = {path.stem: path for path in running}
    if name is None and len(names) == 1:
        (name,) = names
    if name is None or name not in names:
        hint = name_hint(name or "", names, "ones that run") if names else "nothing does"
        named = "" if name is None else f" as '{name}'"
        raise ConfigurationError(f"no `contactfusion live` runs{named}: {hint}")
    try:
        line = order.encode() + b"\n"
    except UnicodeEncodeError:
        raise ConfigurationError(f"the order {order!r} is no text in UTF-8") from None
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(2.0 * PATIENCE)
            connection.connect(str(names[name]))
            connection.sendall(line)
            answer = json.loads(_line(connection))
    except (ConfigurationError, OSError):
        raise ConfigurationError(f"'{name}' ended, or hangs: it gave no answer") from None
    if not answer["ok"]:
        raise ConfigurationError(answer["text"])
    return str(answer["text"])


def _answers(path: Path) -> bool:
    """Whether someone listens at a socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(1.0)
        return connection.connect_ex(str(path)) == 0


def _line(connection: socket.socket) -> str:
    """A line of text.

    Raises:
        ConfigurationError: it does not end.
        OSError: it does not come in time.
    """
    received = b""
    while not received.endswith(b"\n"):
        part = connection.recv(LONGEST)
        received += part
        if not part or len(received) > 64 * LONGEST:
            raise ConfigurationError("an order is one line of text")
    return received.decode(errors="replace").strip()
