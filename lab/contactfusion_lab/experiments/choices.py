"""What a user chooses by name: of what there is, once each."""

from collections.abc import Collection, Mapping, Sequence
from typing import TypeVar

from contactfusion.errors import ConfigurationError, name_hint

T = TypeVar("T")
LISTED = 30
"""Of more names the nearest are no help."""


def require_known(names: Sequence[str], known: Collection[str], one: str, many: str) -> None:
    """Make sure that names are known.

    Args:
        names: to look for.
        known: the names that there are.
        one: what a name is for.
        many: the plural of that.

    Raises:
        ConfigurationError: one is not.
    """
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown {one} '{name}'; {name_hint(name, known, many)}")


def require_once(names: Sequence[str], many: str) -> None:
    """Make sure that no name stands twice.

    Args:
        names: to look at.
        many: the plural of what they are for.

    Raises:
        ConfigurationError: one does.
    """
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ConfigurationError(f"'{twice}' stands twice among the {many}")


def trial_called(told: str, trials: Mapping[str, T]) -> T:
    """Find a trial by its name or the end of it; of several it is the first.

    Args:
        told: such as "COLUMN/NAME", or NAME.
        trials: by name, their parts with "/" between them.

    Raises:
        ConfigurationError: there is none.
    """
    name = next((name for name in trials if f"/{name}".endswith(f"/{told}")), None)
    if name is None:
        parts = told.count("/") + 1
        known = list(dict.fromkeys("/".join(name.split("/")[-parts:]) for name in trials))
        few = len(known) <= LISTED
        hint = name_hint(told, known, "trials") if few else f"one is '{known[0]}'"
        raise ConfigurationError(f"unknown trial '{told}'; {hint}", "record")
    return trials[name]
