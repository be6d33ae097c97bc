"""Changes of a pipeline while it runs, by one line of text: as typed, recorded and played again."""

import functools
import shlex
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, final

from contactfusion.errors import ConfigurationError, ContactFusionError, SourceError, name_hint
from contactfusion.files import texts_of
from contactfusion.isolation import Isolated
from contactfusion.yaml_files import with_overrides

if TYPE_CHECKING:
    from contactfusion.pipeline import Pipeline


@final
class Change:
    """A change of a pipeline, and what came of it.

    Args:
        text: such as "threshold 0.6" or "tare wrist"; `USES` has all.
        within: the folder in which all files lie that its options name, as of a change that comes
            from a recording; None: no limit.

    Attributes:
        text: as given.
        outcome: a sentence on what was changed, once it is carried out, or why it could not be.
    """

    def __init__(self, text: str, within: Path | None = None) -> None:
        self.text = text
        self._within = within
        self.outcome = Future[str]()

    def carry_out(self, pipeline: "Pipeline") -> None:
        """Change a pipeline, between two of its readings."""
        settle(self.outcome, functools.partial(_changed, pipeline, self.text, self._within))


def settle(outcome: "Future[str]", do: Callable[[], str]) -> None:
    """Do something that another thread waits for, unless it has given up."""
    if not (outcome.running() or outcome.set_running_or_notify_cancel()):
        return
    try:
        outcome.set_result(do())
    except Exception as error:  # it is for who waits, and ends no loop
        outcome.set_exception(error)


def _changed(pipeline: "Pipeline", text: str, within: Path | None) -> str:
    name, *arguments = words(text)
    if name == "plug":
        return _plug(pipeline, within, *arguments)
    return _CHANGES[name](pipeline, *arguments)


def words(text: str) -> list[str]:
    """The words of a change, the first its name.

    Raises:
        ConfigurationError: there is no such change, or it takes other words.
    """
    if not text.isprintable():
        raise ConfigurationError(f"{text!r} is no line of text")
    try:
        split = shlex.split(text)
    except ValueError as error:
        raise ConfigurationError(f"'{text}': {error}") from None
    if not split or split[0] not in USES:
        raise ConfigurationError(
            f"unknown change '{split[0] if split else ''}'; "
            + name_hint(split[0] if split else "", USES, "changes")
        )
    name, *arguments = split
    use = USES[name]
    least = 2 if name == "answer" else 1
    if len(arguments) < least or (len(arguments) > least and not use.endswith("…")):
        raise ConfigurationError(f"'{text}': write {name} {use}")
    return split


def _threshold(pipeline: "Pipeline", value: str) -> str:
    try:
        threshold = float(value)
    except ValueError:
        raise ConfigurationError(f"'{value}' is no number", "integrator.threshold") from None
    before = pipeline.integrator.config.threshold
    pipeline.integrator.set_threshold(threshold)
    return f"the threshold is {threshold:g}, and was {before:g}"


def _plug(pipeline: "Pipeline", within: Path | None, name: str, *options: str) -> str:
    for sign in "/.":
        if sign in name:
            raise ConfigurationError(f"a name may not hold '{sign}'", f"generators.{name}")
    fields: dict[str, Any] = {"generators": dict(pipeline.config.generators)}
    changed = with_overrides(fields, [f"generators.{name}.{option}" for option in options])
    found = changed["generators"].get(name) or {}
    if not isinstance(found.get("type"), str):
        hint = name_hint(name, pipeline.config.generators, "generators of the configuration")
        raise SourceError(f"'{name}' has no type: write plug {name} type=…, or {hint}")
    # a change without new texts names no file but those of the configuration itself
    known = set(texts_of(pipeline.config.generators.get(name)))
    pipeline.plug(name, found, None if known.issuperset(texts_of(found)) else within)
    return f"'{name}' is plugged"


def _unplug(pipeline: "Pipeline", name: str) -> str:
    pipeline.unplug(name)
    return f"'{name}' is unplugged"


def _tare(pipeline: "Pipeline", name: str) -> str:
    generator = pipeline.plugged(name)
    if not tares(generator):
        fitting = [known for known, each in pipeline.generators.items() if tares(each)]
        hint = name_hint(name, fitting, "generators with an option `tare` above 0")
        raise ConfigurationError(f"'{name}' takes no tare; {hint}")
    pipeline.restart(name)
    return f"'{name}' takes its tare of {generator.config.tare:g} s again"


def _restart(pipeline: "Pipeline", name: str) -> str:
    pipeline.restart(name)
    return f"'{name}' starts again"


def _isolate(pipeline: "Pipeline", name: str) -> str:
    if isinstance(pipeline.plugged(name), Isolated):
        return f"'{name}' runs in a process of its own already"
    options, within = {**pipeline.options[name], "isolate": True}, pipeline.bounds[name]
    pipeline.unplug(name)
    try:
        pipeline.plug(name, options, within)
    except ContactFusionError as error:
        raise SourceError(f"'{name}' is unplugged: {error}") from None
    return f"'{name}' runs in a process of its own from now on"


def _answer(pipeline: "Pipeline", name: str, number: str) -> str:
    if not (number.isdecimal() and len(number) < 19):
        raise ConfigurationError(f"'{number[:19]}' is no number of a reading")
    pipeline.answer(name, int(number))
    return f"the clouds of reading {number} of '{name}' have come"


def tares(generator: Any) -> bool:
    """Whether a generator takes a tare."""
    return bool(getattr(generator.config, "tare", 0.0))


_CHANGES: Final[Mapping[str, Callable[..., str]]] = {
    "threshold": _threshold,
    "unplug": _unplug,
    "tare": _tare,
    "restart": _restart,
    "isolate": _isolate,
    "answer": _answer,
}
USES: Final[Mapping[str, str]] = {
    "threshold": "VALUE",
    "plug": "NAME [OPTION=VALUE]…",
    "unplug": "NAME",
    "tare": "NAME",
    "restart": "NAME",
    "isolate": "NAME",
    "answer": "NAME NUMBER",
}
"""The changes by name, and the words that they take; `answer` is recorded, and never typed: when
the clouds of an isolated generator came."""
