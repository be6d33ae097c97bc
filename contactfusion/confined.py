"""Calls of libraries that hang, crash or take all memory on broken files: in a process with limits.

A process costs its start and the import of the library, and keeps the caller from nothing else: it
has the rights of its caller, and is no sandbox.
"""

import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

from contactfusion.limits import raised

SECONDS: Final = 20.0
"""The time that a call may take, of the clock and of the processor [s]."""
START_SECONDS: Final = 10.0
"""The time to start the process, on a busy machine [s]."""
MEMORY: Final = 2**30
"""The memory that a call may take beside its libraries [bytes]."""
START: Final = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from contactfusion import confined
confined.serve(sys.stdin.buffer)
"""
"""The program of the process; isolated, so that no module is taken from the working folder."""


class LimitError(Exception):
    """A confined call ended its process, or took longer or more memory than it may; a clause."""


def confined(
    function: Callable[..., Any], *arguments: Any, seconds: float = SECONDS, memory: int = MEMORY
) -> Any:
    """The result of a function that is called in a process of its own.

    Args:
        function: of a module, which the process imports.
        arguments: of the function; they and its result can be pickled.
        seconds: the time that it may take [s].
        memory: the memory that it may take [bytes]; not limited on Windows.

    Raises:
        LimitError: the process crashed, or went beyond a limit.
        Exception: that which the function raised.
    """
    command = [sys.executable, "-I", "-c", START]
    seconds, memory = raised(seconds), round(raised(memory))
    call = function.__module__, function.__qualname__, arguments, seconds, memory
    given = pickle.dumps([path for path in sys.path if path]) + pickle.dumps(call)
    status, answer, _ = completed(command, given, seconds=seconds + START_SECONDS)
    if status or not answer:
        raise LimitError(ending(status))
    succeeded, result = pickle.loads(answer)
    if succeeded:
        return result
    if isinstance(result, MemoryError):
        raise LimitError(f"it took more memory than {memory / 2**30:.1f} GiB")
    raise result


def completed(
    command: Sequence[str], given: bytes = b"", *, seconds: float, memory: int = 0
) -> tuple[int, bytes, bytes]:
    """The exit status, the output and the errors of a program.

    Args:
        command: the program and its arguments.
        given: its input.
        seconds: the time that it may take [s].
        memory: the addresses that it may take [bytes], on Linux; 0: no limit.

    Raises:
        LimitError: it took longer.
    """
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        if memory and sys.platform == "linux":
            import resource

            resource.prlimit(process.pid, resource.RLIMIT_AS, (memory, memory))
        try:
            out, errors = process.communicate(given, timeout=seconds)
        except subprocess.TimeoutExpired:
            raise LimitError(f"it took longer than {seconds:.0f} s") from None
        finally:
            process.kill()
    return process.returncode, out, errors


def serve(given: BinaryIO) -> None:
    """Call the function that is given, in the process: its result goes to stdout, pickled."""
    import importlib
    import os

    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a library may print
    module, name, arguments, seconds, memory = pickle.load(given)
    function = getattr(importlib.import_module(module), name)
    _limit(seconds, memory)
    try:
        answer = pickle.dumps((True, function(*arguments)), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        answer = pickle.dumps((False, _portable(error)))
    out.write(answer)
    out.close()


def _portable(error: Exception) -> Exception:
    """An error that can be pickled and made again."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickle raises anything
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _limit(seconds: float, memory: int) -> None:
    if sys.platform == "win32":
        return
    import resource

    status = Path("/proc/self/statm")
    pages = int(status.read_text().split()[0]) if status.exists() else 0
    held = pages * resource.getpagesize()
    for kind, limit in (
        (resource.RLIMIT_AS, held + memory),
        (resource.RLIMIT_CPU, max(1, round(seconds))),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (limit, limit))


def ending(status: int) -> str:
    """The clause on a process that ended by itself, by its exit status."""
    if status in (-signal.SIGKILL, -getattr(signal, "SIGXCPU", signal.SIGKILL)):
        return "it took longer than it may, or more memory than there is"
    name = signal.Signals(-status).name if status < 0 else f"exit status {status}"
    return f"it crashes the library that reads it ({name})"
