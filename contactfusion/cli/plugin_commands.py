"""Commands of plug-ins: the entry points of the group `contactfusion_commands`.

An entry point is named like its command, GROUP.COMMAND in a group, and gives a function as typer
takes it, or a `typer.Typer` with the commands of a group. It is imported when it, or its help, is
asked for.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

from contactfusion.errors import ContactFusionError, DependencyError, PluginError, cause_in
from contactfusion.extras import in_lab
from contactfusion.plugins import Plugin, in_order, plugin_of

GROUP = "contactfusion_commands"
LAB_COMMANDS = ("demo", "experiment", "simulate", "train", "tune.push")
"""Commands that contactfusion-lab brings."""
ANYTHING = {"ignore_unknown_options": True, "allow_extra_args": True}


class PluginGroup(TyperGroup):
    """A group that imports a command of a plug-in when it is asked for."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by its name; None: there is none."""
        command = self.commands.get(cmd_name)
        if isinstance(command, LateCommand):
            self.commands[cmd_name] = command = command.loaded()
        return command


class LateCommand(TyperGroup):
    """A command of a plug-in that is not imported yet.

    Args:
        point: its entry point.
        finish: what is done to it, and to each of its commands, once it is imported.

    Attributes:
        commands: what other plug-ins add to the group that it is.
    """

    def __init__(self, point: EntryPoint, finish: Callable[[Any], None]) -> None:
        super().__init__(name=point.name.rpartition(".")[2])
        self._point, self._finish = point, finish

    def loaded(self) -> Any:
        """The command, or one that says why it cannot be used."""
        command = _imported(self._point)
        if isinstance(command, str):
            words = self._point.name.replace(".", " ")
            owner = plugin_of(self._point).distribution
            sentence = f"the command '{words}' of {owner} cannot be used: {command}"
            command = _refusing(self.name, PluginError(sentence), f"Cannot be used: {command}.")
        command.name = self.name
        inner = getattr(command, "commands", {})
        for name, late in self.commands.items():
            if name not in inner and isinstance(late, LateCommand):
                inner[name] = late.loaded()
        self._finish(command)
        return command


def add_commands(program: TyperGroup, finish: Callable[[Any], None]) -> Mapping[str, str]:
    """Add the commands of plug-ins to the program; none of them is imported.

    Args:
        program: all commands; its groups take further ones.
        finish: what is done to each command once it is imported.

    Returns:
        Why a command was left out, by its name.
    """
    failures: dict[str, str] = {}
    for point in in_order(entry_points(group=GROUP)):
        group, name = _group_of(program, point.name)
        if group is None:
            failures[point.name] = f"there is no group '{point.name.partition('.')[0]}'"
        elif name in group.commands:
            failures[f"{point.name} ({plugin_of(point).distribution})"] = (
                f"the name '{point.name}' is taken"
            )
        else:
            group.commands[name] = LateCommand(point, finish)
    for path in LAB_COMMANDS:
        group, name = _group_of(program, path)
        if group is not None and name not in group.commands:
            sentence = in_lab(f"`contactfusion {path.replace('.', ' ')}`")
            group.commands[name] = _refusing(
                name, DependencyError(sentence), f"{sentence}.", hidden=True
            )
    return failures


def installed_commands() -> tuple[Plugin, ...]:
    """The commands of plug-ins, without importing any; modules as MODULE:FUNCTION."""
    return tuple(
        replace(plugin_of(point), module=point.value)
        for point in in_order(entry_points(group=GROUP))
    )


def import_failures() -> dict[str, str]:
    """Import every command of a plug-in: why some cannot be used, by their names.

    Only then is it known whether a group of a plug-in has a command that another adds to it.
    """
    found = {point.name: _imported(point) for point in in_order(entry_points(group=GROUP))}
    failures = {name: why for name, why in found.items() if isinstance(why, str)}
    for path in found:
        group, _, name = path.rpartition(".")
        if name in getattr(found.get(group), "commands", {}):
            failures[path] = f"the name '{path}' is taken"
    return failures


def _imported(point: EntryPoint) -> Any:
    """The command of an entry point, or why it cannot be used."""
    try:
        given = point.load()
        if isinstance(given, typer.Typer):
            return get_group(given)
        app = typer.Typer(add_completion=False)
        app.command()(given)
        return get_command(app)
    except (Exception, SystemExit) as error:  # no stranger's module may take others down
        return cause_in(error, point.module)


def _group_of(program: TyperGroup, path: str) -> tuple[TyperGroup | None, str]:
    """The group that a command belongs to, where there is one, and the command's own name."""
    word, _, name = path.rpartition(".")
    group: Any = program.commands.get(word) if word else program
    return (group if isinstance(group, TyperGroup) else None), name


def _refusing(
    name: str | None, error: ContactFusionError, help_: str, hidden: bool = False
) -> TyperCommand:
    """A command that raises an error, whatever it is given."""

    def refuse() -> NoReturn:
        raise error

    return TyperCommand(name, callback=refuse, help=help_, hidden=hidden, context_settings=ANYTHING)
