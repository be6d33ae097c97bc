"""The errors of contactfusion, and the sentence that names what exists."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches


class ContactFusionError(Exception):
    """The root of every error that contactfusion raises on purpose."""


class ConfigurationError(ContactFusionError, ValueError):
    """A configuration holds a field or a value that it may not hold.

    Args:
        problem: what is wrong.
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
        """Give the same error as seen from the configuration that holds this one at `path`."""
        return self.of([f._below(path) for f in self.faults])

    def _below(self, path: str) -> "ConfigurationError":
        return ConfigurationError(self.problem, ".".join(filter(None, (path, self.path))))


class InvalidCloudError(ContactFusionError, ValueError):
    """A cloud of hypotheses holds values that no likelihood or place can have."""


class InvalidReadingError(ContactFusionError, ValueError):
    """A reading holds values that its sensor cannot have given."""


class FrameError(ContactFusionError, ValueError):
    """A frame is unknown, unconnected, or not the one that is asked for."""


class SourceError(ContactFusionError, ValueError):
    """A source is unknown, unplugged, or of another kind."""


class TimeError(ContactFusionError, ValueError):
    """Time ran backwards."""


class PluginError(ContactFusionError):
    """A plug-in is missing, broken, or breaks the contract."""


class RecordingError(ContactFusionError):
    """A recording is missing, truncated, or not what it says it is."""


class WritingError(ContactFusionError):
    """A file can't be written, as when the disk is full."""


class RobotError(ContactFusionError, ValueError):
    """The description of a robot does not hold together, or does not fit its readings."""


class DependencyError(ContactFusionError, ImportError):
    """A package of an extra is not installed."""


def name_hint(name: str, known: Iterable[str], what: str) -> str:
    """Say what exists and which of it was probably meant.

    Args:
        name: the name that was not found.
        known: the names that exist.
        what: the plural of what they name, e.g. "sources".

    Returns:
        A clause such as ``did you mean 'skin'? The sources are: skin, wrist``.
    """
    names = sorted(known)
    if not names:
        return f"there are no {what}"
    listing = f"the {what} are: {', '.join(names)}"
    close = get_close_matches(name, names, n=1)
    return f"did you mean '{close[0]}'? {listing[0].upper()}{listing[1:]}" if close else listing


def missing_extra(package: str, extra: str) -> DependencyError:
    """Give the error for a package that belongs to an extra that is not installed."""
    return DependencyError(
        f"{package} is not installed; install it with: pip install 'contactfusion[{extra}]'"
    )
