"""Builds a C++ program on the fly and talks to it line by line."""

import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG")


class NativeError(RuntimeError):
    """A C++ program could not be built, or did not answer."""


def build(source: Path, *, flags: Sequence[str] = (), packages: Sequence[str] = ()) -> Path:
    """Compile one C++ file with ``FLAGS``; what was built before is found again.

    Args:
        source: the file.
        flags: further flags of the compiler.
        packages: pkg-config names of the libraries that it needs.

    Returns:
        the program.

    Raises:
        NativeError: the compiler or a library is missing, or the file does not compile.
    """
    compiler = os.environ.get("CXX", "g++")
    if shutil.which(compiler) is None:
        raise NativeError(f"{source.name} needs the C++ compiler {compiler}: apt install g++")
    includes, libraries = _package_flags(source, packages)
    command = [compiler, *FLAGS, *flags, *includes, str(source)]
    # "native" names the machine, so the key must: a home folder may be shared between machines.
    target = _output([compiler, "-march=native", "-Q", "--help=target", "--version"])
    key = "\n".join([*command, *libraries, target]).encode() + source.read_bytes()
    program = build_folder() / f"{source.stem}-{hashlib.sha256(key).hexdigest()[:16]}"
    if not program.exists():
        # Compiled aside and moved, so that a build cut short leaves nothing behind.
        with tempfile.TemporaryDirectory(dir=program.parent) as scratch:
            fresh = Path(scratch) / "program"
            done = subprocess.run(
                [*command, "-o", str(fresh), *libraries], capture_output=True, text=True
            )
            if done.returncode != 0:
                raise NativeError(f"{source.name} does not compile:\n{done.stderr[:2000]}")
            fresh.replace(program)
    return program


def build_folder() -> Path:
    """Give the folder of built programs, made when it is missing.

    Returns:
        a folder in the user's cache, or in the system's temporary folder when that is read-only.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser()
    for folder in (cache, Path(tempfile.gettempdir()) / f"cache-{os.getuid()}"):
        try:
            built = folder / "contactfusion" / "benchmarks"
            built.mkdir(parents=True, exist_ok=True)
            if os.access(built, os.W_OK):
                return built
        except OSError:
            continue
    raise NativeError("no folder can be written to build C++ programs in: set XDG_CACHE_HOME")


class Server:
    """A program that answers each line on its input with one line on its output."""

    def __init__(self, program: Path) -> None:
        """Start the program.

        Args:
            program: what ``build`` gave.
        """
        self._process = subprocess.Popen(
            [str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._name = program.name

    def ask(self, line: str) -> list[str]:
        """Give one command and wait for its answer.

        Args:
            line: the command and its arguments.

        Returns:
            the words of the answer.

        Raises:
            NativeError: the program ended, or answered ``error``.
        """
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(line + "\n")
            answer = self._process.stdout.readline().split()
        except BrokenPipeError:
            answer = []
        if not answer:
            raise NativeError(f"{self._name} ended at {line!r} (status {self._process.wait()})")
        if answer[0] == "error":
            raise NativeError(f"{self._name} refused {line!r}: {' '.join(answer[1:])}")
        return answer

    def close(self) -> None:
        """End the program by closing its input."""
        self._process.communicate()


def _package_flags(source: Path, packages: Sequence[str]) -> tuple[list[str], list[str]]:
    if not packages:
        return [], []
    names = " ".join(packages)
    if shutil.which("pkg-config") is None:
        raise NativeError(f"{source.name} needs pkg-config to find {names}: apt install pkg-config")
    if subprocess.run(["pkg-config", "--exists", *packages]).returncode != 0:
        raise NativeError(
            f"{source.name} needs the libraries {names}, which pkg-config cannot find"
        )
    includes = _output(["pkg-config", "--cflags", *packages]).split()
    return includes, _output(["pkg-config", "--libs", *packages]).split()


def _output(command: Sequence[str]) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
