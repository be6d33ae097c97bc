"""Files: written whole or not at all, bounds of names in recordings, and arrays in npz files."""

import fcntl
import io
import json
import lzma
import os
import re
import secrets
import signal
import threading
import time
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from functools import lru_cache
from itertools import chain, count
from pathlib import Path
from shutil import rmtree
from stat import S_ISDIR, S_ISREG
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactfusion.errors import ConfigurationError, ContactFusionError, WritingError
from contactfusion.unpacking import require_arrays

GIVE_CONFIG: Final = "give the configuration itself by --config FILE"
"""The advice where a configuration in a recording names a file that it may not."""
UNFINISHED: Final = ".unfinished"
"""The suffix of what is being written, until it gets its name."""
HIDDEN: Final = re.compile(rf"(?s)\.(.*[^.].*)\.[0-9a-f]{{8}}{re.escape(UNFINISHED)}")
"""The names of what is being written; they hold the name that it gets."""
LONGEST: Final = 200
"""The greatest length of a name that is given further words [bytes]; file systems take 255."""
STALE: Final = 3600.0
"""The age at which what a killed writer left is removed by the next one [s]."""
SHIPPED: Final = Path(__file__).resolve().parent
"""The folder of this package."""
BROKEN = (
    EOFError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    lzma.LZMAError,
    zipfile.BadZipFile,
    zlib.error,
)
"""Exceptions of numpy and zipfile for files of other formats, encrypted, or of unknown compression.
"""


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file whole or not at all, also when the writing is interrupted.

    Args:
        path: the file; its folder is made if necessary.
        content: text, written as UTF-8, or bytes.

    Raises:
        WritingError: the file can't be written; an older file stays.
        ContactFusionError: its folder cannot be made.
    """
    path = Path(path)
    try:
        with whole_file(path) as temporary:
            temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        why = error.strerror or str(error)
        raise WritingError(f"{path} can't be written: {why}; nothing of it was kept") from None


@contextmanager
def unfinished(path: Path, is_folder: bool = False) -> Iterator[Path]:
    """A hidden file or folder beside a path, for what becomes it; it is gone afterwards.

    A lock on it says to others, also to those in another container, that its writer lives.

    Args:
        path: the file that it becomes; its folder is made if necessary.
        is_folder: whether what becomes it lies in a folder.

    Raises:
        ContactFusionError: its folder cannot be made, or a folder, a device or a pipe has its name.
        OSError: it cannot be made itself.
    """
    make_folder(path.parent)
    if not is_folder and path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "no regular file"
        raise WritingError(f"{path} can't be written: it is {kind}")
    _sweep(path.parent)
    # absolute, as a plug-in may change the folder of the process
    temporary = path.absolute().with_name(
        f".{_short(path.name)}.{secrets.token_hex(4)}{UNFINISHED}"
    )
    if is_folder:
        temporary.mkdir()
    else:
        temporary.touch()
    lock = os.open(temporary, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(lock, fcntl.LOCK_SH)
        yield temporary
    finally:
        os.close(lock)
        if is_folder:
            rmtree(temporary, ignore_errors=True)
        else:
            with suppress(OSError):
                temporary.unlink()


@lru_cache(maxsize=256)
def _sweep(folder: Path) -> None:
    """See, once, to what was being written by processes that were killed.

    A recording gets a name that says that it is cut; the rest is removed after a time.
    """
    for left in folder.glob(f".*{UNFINISHED}"):
        with suppress(OSError):
            named, mode = HIDDEN.fullmatch(left.name), left.lstat().st_mode
            # what is neither file nor folder, and links, is no writer's of ours
            if not named or not (S_ISREG(mode) or S_ISDIR(mode)) or _is_written(left):
                continue
            for written in left.rglob("*.mcap") if left.is_dir() else ():
                found = written.lstat()
                if S_ISREG(found.st_mode) and found.st_size:
                    os.replace(written, _name_of_cut(folder / named[1]))
            if time.time() - left.stat().st_mtime > STALE:
                rmtree(left) if left.is_dir() else left.unlink()


def _is_written(left: Path) -> bool:
    """Whether a process that lives holds the lock on an unfinished file, or that is not known."""
    lock = os.open(left, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(lock)
    return False


def _short(name: str) -> str:
    """A name that leaves room for more, with its suffix."""
    stem, suffix = os.path.splitext(name)
    if len(os.fsencode(suffix)) > LONGEST // 2:
        stem, suffix = name, ""
    room = LONGEST - len(os.fsencode(suffix))
    return os.fsencode(stem)[:room].decode(errors="ignore") + suffix


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary name for a file that is written in parts; it gets its own at the end.

    After an exception the parts are removed, and an older file stays.

    Args:
        path: the file, or a link to it; its folder is made if necessary.

    Raises:
        WritingError: it is a link to itself.
    """
    try:
        path = path.resolve() if path.is_symlink() else path
    except RuntimeError:
        raise WritingError(f"{path} can't be written: it is a link to itself") from None
    final = path.absolute()
    with unfinished(path) as temporary:
        yield temporary
        os.replace(temporary, final)


def make_folder(path: Path) -> None:
    """Make a folder for results, and its parents.

    Raises:
        ContactFusionError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ContactFusionError(f"the folder {path} cannot be made: {error.strerror}") from None


def file_in(folder: Path, name: str | Path, within: Path | None) -> Path:
    """The path of a file, within bounds.

    Args:
        folder: that of a relative name.
        name: of the file.
        within: the folder that the file has to lie in, links resolved, unless it is one of this
            package, as of a configuration in a recording; None: no limit.

    Raises:
        ConfigurationError: the name leads elsewhere, or is absolute where `within` is given.
    """
    path, absolute = folder / name, Path(name).is_absolute()
    if within is None:
        return path
    try:
        found = path.resolve()
        allowed = found.is_relative_to(SHIPPED) or (
            found.is_relative_to(within.resolve()) and not absolute
        )
    except (OSError, RuntimeError, ValueError):  # links in a circle, or a NUL in the name
        allowed = False
    if not allowed:
        where = "" if absolute else f" from {folder}"
        raise ConfigurationError(
            f"a configuration that comes from a recording may name files in "
            f"{within.resolve()} only, not {str(name)!r}{where}; {GIVE_CONFIG}"
        )
    return path


def require_file(path: Path, error: type[ContactFusionError]) -> None:
    """Refuse a file that does not exist, or is no regular one.

    Raises:
        error: it is none; where it does not exist, the sentence names the file of the folder that
            was probably meant.
    """
    try:
        if path.is_file():
            return
    except OSError as cause:  # its name is too long, or a folder may not be entered
        raise error(f"{str(path)[:200]} can't be read: {cause.strerror}") from None
    if path.is_dir():
        raise error(f"{path} is a folder, not a file")
    if path.exists():
        raise error(f"{path} is no regular file")
    if not path.parent.is_dir():
        raise error(f"there is no file {path}, nor its folder {path.parent}")
    others = [entry.name for entry in path.parent.iterdir() if entry.name != path.name]
    close = get_close_matches(path.name, others, n=1)
    hint = f"; did you mean '{close[0]}'?" if close else ""
    raise error(f"there is no file '{path.name}' in {path.parent.resolve()}{hint}")


def named_files(fields: object, folder: Path, within: Path | None = None) -> Iterator[Path]:
    """The files and folders that exist of those that a configuration names, at any depth.

    The folder of relative names, and those that hold it, are left out.

    Args:
        fields: of the configuration.
        folder: that of relative names.
        within: as for `file_in`; what that refuses is left out.
    """
    for name in texts_of(fields):
        # a long text, one with a NUL, or a name that may not be used
        with suppress(OSError, ValueError, ConfigurationError):
            path = file_in(folder, name, within)
            holds = path.is_dir() and folder.resolve().is_relative_to(path.resolve())
            if path.exists() and not holds:
                yield path


def texts_of(fields: object) -> Iterator[str | Path]:
    """The texts and paths among the values of fields, at any depth: only they can name files."""
    if isinstance(fields, Mapping):
        fields = list(fields.values())
    if isinstance(fields, list | tuple):
        for field in fields:
            yield from texts_of(field)
    elif isinstance(fields, str | Path):
        yield fields


def require_spared(option: str, out: Path, read: Iterable[Path]) -> None:
    """Refuse an output that would replace what is read.

    Args:
        option: that names it, for the sentence.
        out: the output.
        read: the files and folders that are read.

    Raises:
        ConfigurationError: it is one of them, or lies in one, or is a link to itself.
    """
    try:
        place = out.resolve()
    except RuntimeError:
        raise ConfigurationError(f"{option}: {out} is a link that leads to itself") from None
    for path in map(Path.resolve, read):
        if place == path or (path.is_dir() and path in place.parents):
            raise ConfigurationError(
                f"{option}: {out} would replace what is read, {path.name}; name another file"
            )


def require_settings(settings: dict[str, Any], out: Path) -> None:
    """Refuse a folder with results of other settings.

    Raises:
        ConfigurationError: it holds others.
    """
    settings, path = json.loads(json.dumps(settings)), out / "settings.json"
    held: Any = None
    if path.is_file():
        with suppress(ConfigurationError):
            held = read_json(path)
        if not isinstance(held, dict):
            raise ConfigurationError(f"{path} is damaged: give another --out")
        other = [name for name in {**held, **settings} if held.get(name) != settings.get(name)]
        if other:
            raise ConfigurationError(
                f"{out} holds work of other {' and '.join(other)}: give another --out"
            )
    elif any(out.iterdir()):
        raise ConfigurationError(f"{out} holds something else: give another --out")
    write_whole(path, json.dumps(settings, indent=1) + "\n")


def read_json(path: Path) -> Any:
    """The content of a JSON file.

    Raises:
        ConfigurationError: the file is missing, can't be read, or is no JSON text in UTF-8.
    """
    require_file(path, ConfigurationError)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise ConfigurationError(f"{path} is no JSON text, or is cut off") from None
    except OSError as error:
        raise ConfigurationError(f"{path} can't be read: {error.strerror}") from None


def read_npz(path: Path, *names: str) -> list[NDArray[Any]]:
    """Read the arrays of these names.

    Raises:
        ConfigurationError: the file is missing, is no npz file, or lacks an array.
    """
    held = read_arrays(path, *names)
    return [held[name] for name in names]


def read_arrays(path: Path, *names: str) -> dict[str, NDArray[Any]]:
    """Read all arrays by their names; those of `names` must be there.

    Raises:
        ConfigurationError: the file is missing, is no npz file, or lacks an array.
    """
    require_file(path, ConfigurationError)
    try:
        require_arrays(path)
        with path.open("rb") as file, np.load(file) as arrays:
            held = {name: arrays[name] for name in arrays}
    except BROKEN as error:
        raise ConfigurationError(
            f"{path} is no npz file of numbers, or is cut off: {error}"
        ) from None
    if missing := [name for name in names if name not in held]:
        holds = ", ".join(held) or "nothing"
        raise ConfigurationError(f"{path} lacks {' and '.join(missing)}; it holds {holds}")
    return held


def write_npz(path: str | Path, **arrays: ArrayLike) -> None:
    """Write arrays by their names; the file appears whole or not at all."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **{name: np.asarray(a) for name, a in arrays.items()})
    write_whole(path, content.getvalue())


@contextmanager
def kept_when_cut(written: Path, path: Path) -> Iterator[None]:
    """Keep the part of a file that was written before an error, under a name that says so.

    Args:
        written: the temporary path of the file.
        path: its final path.

    Raises:
        WritingError: that which was raised, with the name of the part.
    """
    final = path.absolute()
    try:
        yield
    except WritingError as error:
        if not written.is_file() or not written.stat().st_size:
            raise WritingError(f"{error}; nothing of it was kept") from None
        kept = _name_of_cut(final)
        os.replace(written, kept)
        shown = path.with_name(kept.name)
        raise WritingError(f"{error}; what was written until then is {shown}") from None


def _name_of_cut(path: Path) -> Path:
    """A name that is free, for the part of a file that was written."""
    numbers = chain([""], count(2))
    path = path.with_name(_short(path.name))
    names = (path.with_suffix(f".cut{number}{path.suffix}") for number in numbers)
    return next(name for name in names if not name.exists())


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C, SIGTERM and SIGHUP back while files are closed: they would be lost.

    Raises:
        KeyboardInterrupt: at the end, unless the program itself handles the signal.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held = list[int]()
    before = {
        number: signal.signal(number, lambda number, frame: held.append(number))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for first in held[:1]:
            signal.raise_signal(first)


@contextmanager
def as_writing_error(path: Path) -> Iterator[None]:
    """Convert errors of the system, such as of a full disk, to a sentence.

    Raises:
        WritingError: in place of the system's error.
    """
    try:
        yield
    except OSError as error:
        raise WritingError(f"{path} can't be written: {error.strerror or error}") from None
