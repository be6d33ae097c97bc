"""Choices of a user by name, each known and given once."""

from collections.abc import Collection, Sequence

from contactfusion.errors import ConfigurationError, name_hint

LISTED = 30
"""Number of names up to which all are listed in a hint."""


def require_known(names: Sequence[str], known: Collection[str], kind: str, plural: str) -> None:
    """Make sure that names are known.

    Args:
        names: to look for.
        known: the names that there are.
        kind: what a name is for.
        plural: of that.

    Raises:
        ConfigurationError: a name is not.
    """
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown {kind} '{name}'; {name_hint(name, known, plural)}")


def require_once(names: Sequence[str], plural: str) -> None:
    """Make sure that no name stands twice.

    Args:
        names: to look at.
        plural: of what they are for.

    Raises:
        ConfigurationError: a name does.
    """
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ConfigurationError(f"'{twice}' stands twice among the {plural}")


def trial_named(end: str, names: Collection[str]) -> str:
    """The first trial whose name is this, or ends so.

    Args:
        end: such as "COLUMN/NAME", or NAME.
        names: of the trials, their parts with "/" between them.

    Raises:
        ConfigurationError: there is none.
    """
    found = next((name for name in names if f"/{name}".endswith(f"/{end}")), None)
    if found is None:
        parts = end.count("/") + 1
        known = list(dict.fromkeys("/".join(name.split("/")[-parts:]) for name in names))
        few = len(known) <= LISTED
        hint = name_hint(end, known, "trials") if few else f"one is '{known[0]}'"
        raise ConfigurationError(f"unknown trial '{end}'; {hint}", "record")
    return found
