"""The errors of contactfusion, sentences that list what exists, and the origin of failures."""

import functools
import inspect
import re
import sys
import textwrap
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from types import TracebackType
from typing import Any

LONGEST_CAUSE = 300
"""The greatest length of a foreign exception's message [characters]; longer ones are cut."""

LISTING = re.compile(r"[:;]? [Tt]he ([\w ]+ are: [^;]+)")
"""The list in a sentence with a `name_hint`, and what joins it to the rest."""
GOES_ON = re.compile(r"\?; (.)")
"""The continuation of a sentence after the question of a `name_hint` without its list."""

AGAINST = "take 'sets', and Null hypotheses for what speaks against a contact"
"""What takes the place of likelihoods under a prior."""
DEFAULT = (
    "leave `rule` and `condensation` out, for the default takes any number of contacts, or install "
    "contactfusion-lab, which has it as a baseline"
)
"""What takes the place of rules and condensations that are baselines of the laboratory now."""
REMOVED = {
    "rule": {
        "max": "take 'sets', and only one of the sources that repeat each other",
        "log_odds": AGAINST,
        "dempster_shafer": AGAINST,
        "posterior": DEFAULT,
    },
    "condensation": {"modes": DEFAULT, "cluster_mass": DEFAULT},
}
"""What takes the place of rules and condensations that were removed."""


class ContactFusionError(Exception):
    """The root of every error that contactfusion raises on purpose."""


class ConfigurationError(ContactFusionError, ValueError):
    """A configuration holds a field or a value that is not allowed.

    Args:
        problem: a clause on it.
        path: the field, e.g. "generators.skin.timeout".
    """

    def __init__(self, problem: str, path: str = "") -> None:
        super().__init__(f"{path}: {problem}" if path else problem)
        self.problem, self.path = problem, path
        self._faults: tuple[ConfigurationError, ...] = ()

    @classmethod
    def of(cls, faults: Sequence["ConfigurationError"]) -> "ConfigurationError":
        """The error that states the first of several faults, and counts the others."""
        first, *others = faults
        if not others:
            return first
        whole = cls(f"{first.problem} (and {len(others)} more)", first.path)
        whole._faults = tuple(faults)
        return whole

    @property
    def faults(self) -> tuple["ConfigurationError", ...]:
        """An error for each field that is wrong; itself where it is the only one."""
        return self._faults or (self,)

    def under(self, path: str) -> "ConfigurationError":
        """The same error, with its field below `path`."""
        return self.of([f._below(path) for f in self.faults])

    def _below(self, path: str) -> "ConfigurationError":
        return type(self)(self.problem, ".".join(filter(None, (path, self.path))))


class DefaultError(ConfigurationError):
    """A class of configurations has a default that it refuses itself."""


class InvalidCloudError(ContactFusionError, ValueError):
    """A cloud of hypotheses holds invalid likelihoods or positions."""


class InvalidReadingError(ContactFusionError, ValueError):
    """A reading holds values that are invalid for its sensor."""


class FrameError(ContactFusionError, ValueError):
    """A frame is unknown, unconnected, or not the requested one."""


class SourceError(ContactFusionError, ValueError):
    """A source is unknown, unplugged, or of another kind."""


class TimeError(ContactFusionError, ValueError):
    """Time ran backwards."""


class PluginError(ContactFusionError):
    """A plug-in is missing, cannot be imported, or breaks the contract."""


class RecordingError(ContactFusionError):
    """A recording is missing, truncated, or not of its declared format."""


class WritingError(ContactFusionError):
    """A file can't be written, as when the disk is full."""


class RobotError(ContactFusionError, ValueError):
    """The description of a robot is not valid, or does not match its readings."""


class DependencyError(ContactFusionError, ImportError):
    """A package of an extra is not installed."""


def name_hint(name: str, known: Iterable[str], what: str) -> str:
    """The clause on the names that exist, and on the one that was probably meant.

    Args:
        name: that was not found.
        known: the names that exist.
        what: the plural of what they name, e.g. "sources".

    Returns:
        A clause such as ``did you mean 'skin'? The sources are: skin, wrist``.
    """
    names = sorted(known)
    if not names:
        return f"there are no {what}"
    listing = f"the {what} are: {', '.join(names)}"
    folded = {existing.casefold(): existing for existing in names}
    close = get_close_matches(name.casefold(), folded, n=1)
    if not close:
        return listing
    return f"did you mean '{folded[close[0]]}'? {listing[0].upper()}{listing[1:]}"


def missing_plugin(part: str, name: str, known: Iterable[str], further: str = "") -> PluginError:
    """The error for a plug-in that is not there, or not any more.

    Args:
        part: what it is, e.g. "rule".
        name: that was not found.
        known: the names that exist.
        further: ends the sentence on one that never was.
    """
    if instead := REMOVED.get(part, {}).get(name):
        return PluginError(f"the {part} '{name}' was removed: {instead}")
    hint = name_hint(name, known, f"{part}s")
    return PluginError(f"there is no {part} '{name}'; {hint}{further}")


def listed_once(sentences: Iterable[str], printed: str = "") -> Iterator[str]:
    """Sentences without the lists of `name_hint` that an earlier one holds.

    Args:
        sentences: that are printed, in this order.
        printed: text that is printed beside them.
    """
    seen = set(LISTING.findall(printed))
    for sentence in sentences:
        short = LISTING.sub(lambda found: "" if found[1] in seen else found[0], sentence)
        yield GOES_ON.sub(lambda found: f"? {found[1].upper()}", short)
        seen.update(LISTING.findall(sentence))


def missing_extra(package: str, extra: str) -> DependencyError:
    """The error for a package of an extra that is not installed."""
    return DependencyError(
        f"{package} is not installed; install it with: pip install 'contactfusion[{extra}]'"
    )


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in errors of a wrong configuration.

    Raises:
        ConfigurationError: in place of the error that does not name it.
    """
    try:
        yield
    except (ConfigurationError, FrameError, PluginError) as error:
        raise ConfigurationError(f"{path}: {error}") from error


class Guard:
    """A `with` around code of a plug-in: its exceptions become a sentence that names it.

    Errors of contactfusion are such sentences already, and pass.

    Args:
        who: the name of the plug-in in the sentence.
        cls: its class.

    Raises:
        PluginError: in place of any other exception, or of an exit.
    """

    __slots__ = ("_cls", "_who")

    def __init__(self, who: str, cls: type[Any]) -> None:
        self._who, self._cls = who, cls

    def __enter__(self) -> None:
        """No set-up."""

    def __exit__(
        self, kind: object, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Convert an exception of the plug-in."""
        if isinstance(error, Exception | SystemExit) and not isinstance(error, ContactFusionError):
            raise PluginError(f"{self._who} raised {cause_of(error, self._cls)}") from error


def cause_of(error: BaseException, cls: type[Any]) -> str:
    """The exception of a plug-in, and its origin, see `cause_in`."""
    return cause_in(error, cls.__module__, cls)


def cause_in(error: BaseException, module: str, definition: Any = None) -> str:
    """An exception and its origin, in words.

    Args:
        error: any exception.
        module: the name of the module whose package is searched for in the traceback.
        definition: a class or function, whose position is named when the package is not found.

    Returns:
        A clause such as ``ValueError: no taxels (my_sensor/skin.py, line 12)``; an error of
        contactfusion needs no origin, so that file and line are left out.
    """
    if isinstance(error, ContactFusionError):
        return f"{type(error).__name__}: {error}"
    try:
        text = str(error)
    except Exception:  # of a class that breaks its own
        text = ""
    message = textwrap.shorten(text, LONGEST_CAUSE, placeholder=" …")
    problem = ": ".join(filter(None, (type(error).__name__, message)))
    origin = _place_in(error, module.partition(".")[0]) or place_of(definition)
    return f"{problem} ({origin})" if origin else problem


@functools.cache
def place_of(definition: Any) -> str:
    """File and line of a class or a function; empty when it has no source."""
    try:
        file, line = inspect.getsourcefile(definition), inspect.findsource(definition)[1] + 1
    except (OSError, TypeError):
        return ""
    module = sys.modules.get(definition.__module__)
    return _place(getattr(module, "__package__", ""), file or "", line)


def _place_in(error: BaseException, package: str) -> str:
    if isinstance(error, SyntaxError) and error.filename:
        return _place("", error.filename, error.lineno or 0)
    places = [
        _place(frame.f_globals.get("__package__", ""), frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if frame.f_globals.get("__name__", "").partition(".")[0] == package
    ]
    return places[-1] if places else ""


def _place(package: str | None, file: str, line: int) -> str:
    """A file as it is imported, with a line: equal on every machine."""
    folders = (package or "").replace(".", "/")
    return f"{'/'.join(filter(None, (folders, Path(file).name)))}, line {line}"
