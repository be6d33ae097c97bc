"""The runner of trials: tasks go to workers, each result becomes a file, then all are evaluated."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from contactfusion.errors import ContactFusionError, RobotError
from contactfusion.files import write_whole
from contactfusion.terminal import Progress, note, say
from contactfusion_lab.trials.choices import trial_named
from contactfusion_lab.trials.executor import Executor, WorkerCrashed
from contactfusion_lab.trials.folder import TRIALS, claim, joined, trial_file

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Failure:
    """The failure of a task, in place of a result.

    Attributes:
        why: a sentence.
    """

    why: str


@dataclass(frozen=True)
class Made:
    """A trial that was made.

    Attributes:
        content: of its file.
        cost: of the trial, where it is measured.
    """

    content: bytes
    cost: Any = None


class Experiment(ABC, Generic[T]):
    """Trials, what makes one, and what is written of all; it goes to the workers.

    Attributes:
        trials: the noun for them, such as "pushes".
        suffix: of their files.
        addable: of these settings, mappings by name, a folder may take more.
    """

    trials: ClassVar[str]
    suffix: ClassVar[str]
    addable: ClassVar[Sequence[str]]

    @abstractmethod
    def tasks(self) -> Mapping[str, T]:
        """The trials by name; the parts of a name that end with "/" are folders."""

    @abstractmethod
    def settings(self) -> Mapping[str, Any]:
        """The settings by which a folder can be resumed: equal settings make equal trials."""

    @abstractmethod
    def make(self, task: T) -> Made:
        """Make a trial."""

    def check(self, out: Path, missing: Sequence[str], executor: Executor) -> None:
        """Refuse trials that cannot be made, before any is made.

        Args:
            out: the folder, which there need not be.
            missing: the trials that are not in it.
            executor: workers on this machine.
        """
        return None

    @abstractmethod
    def evaluate(self, out: Path, settings: Mapping[str, Any], failed: Sequence[str]) -> None:
        """Write the tables and figures of all trials.

        Args:
            out: the folder that holds the trials, and takes them.
            settings: of the folder.
            failed: a sentence for each trial that could not be made.
        """

    def film(self, task: T, out: Path) -> tuple[Path, Path]:
        """Make a trial once more; its film and its recording."""
        raise NotImplementedError  # only asked of experiments whose options name trials to film

    def report(self, costs: Mapping[str, Any], out: Path) -> None:
        """Report what the trials of this run took, by name."""
        return None


def run(
    experiment: Experiment[T], executor: Executor, out: Path, filmed: Sequence[str] = ()
) -> None:
    """Make the trials that are not there yet, evaluate all, film some.

    Args:
        experiment: what is made.
        executor: the workers.
        out: the folder of the results.
        filmed: trials to film, by the ends of their names.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds trials of other options.
        RobotError: a trial or a film could not be made; the others are kept.
    """
    tasks, trials, suffix = experiment.tasks(), experiment.trials, experiment.suffix
    chosen = {name: tasks[name] for name in (trial_named(end, tasks) for end in filmed)}
    joined(experiment.settings(), out, experiment.addable, trials)
    experiment.check(out, missing(tasks, out, suffix), executor.local)
    settings = claim(experiment.settings(), out, experiment.addable, trials)
    failed, costs = [], dict[str, Any]()
    for name, made in kept(experiment.make, tasks, out, suffix, trials, executor):
        if isinstance(made, Failure):
            failed.append(made.why)
        elif made.cost is not None:
            costs[name] = made.cost
    if costs:
        experiment.report(costs, out)
    if any((out / TRIALS).rglob(f"*{suffix}")):
        experiment.evaluate(out, settings, failed)
    unfilmed = _film_all(experiment, chosen, executor.local, out)
    problems = []
    if failed:
        problems.append(f"{len(failed)} of {len(tasks)} {trials} were not made: {failed[0]}")
    if unfilmed:
        problems.append(f"{len(unfilmed)} of {len(chosen)} films were not made: {unfilmed[0]}")
    if problems:
        raise RobotError("; ".join(problems))


def _film_all(
    experiment: Experiment[T], chosen: Mapping[str, T], executor: Executor, out: Path
) -> list[str]:
    """Film trials that were made; a sentence for each film that failed."""
    failed, tasks = [], dict[str, T]()
    for name, task in chosen.items():
        if trial_file(out, name, experiment.suffix).is_file():
            tasks[name] = task
        else:
            note(f"not filmed: {name}, which was not made")
    for _, made in finished(partial(experiment.film, out=out), tasks, executor):
        if isinstance(made, Failure):
            failed.append(made.why)
        else:
            say(f"film: {made[0]}; recording: {made[1]}")
    return failed


def missing(tasks: Collection[str], out: Path, suffix: str) -> list[str]:
    """The names of the trials that a folder has no file of."""
    return [name for name in tasks if not trial_file(out, name, suffix).is_file()]


def kept(
    make: Callable[[T], Made],
    tasks: Mapping[str, T],
    out: Path,
    suffix: str,
    trials: str,
    executor: Executor,
) -> Iterator[tuple[str, Made | Failure]]:
    """Make the trials that are not there yet; each is a whole file as soon as it is ready.

    Args:
        make: makes one.
        tasks: all trials, by name.
        out: the folder that takes the files.
        suffix: of these.
        trials: the noun for them, such as "pushes".
        executor: the workers, which write nothing.

    Yields:
        The name of a trial and what was made, or why it was not.
    """
    names = missing(tasks, out, suffix)
    note(f"{len(tasks)} {trials}; {len(names)} to make")
    progress = Progress(trials, len(names))
    for name, made in finished(make, {name: tasks[name] for name in names}, executor):
        if isinstance(made, Made):
            write_whole(trial_file(out, name, suffix), made.content)
        progress.add(1)
        yield name, made


def finished(
    make: Callable[[T], R], tasks: Mapping[str, T], executor: Executor
) -> Iterator[tuple[str, R | Failure]]:
    """Do tasks, by name; what comes of each, as it is ready."""
    names = list(tasks)
    for row, result in executor.results(partial(_attempt, make), list(tasks.values())):
        name = names[row]
        if isinstance(result, WorkerCrashed):
            yield name, Failure(f"{name}: {result.how}")
        else:
            yield name, Failure(f"{name}: {result.why}") if isinstance(result, Failure) else result


def ordered(make: Callable[[T], R], tasks: Mapping[str, T], executor: Executor) -> Iterator[R]:
    """Do tasks, by name; the result of each in the order of the tasks.

    Raises:
        RobotError: a task failed.
    """
    following, results = iter(tasks), dict[str, R | Failure]()
    name = next(following, None)
    for ready, result in finished(make, tasks, executor):
        results[ready] = result
        while name in results:
            due = results.pop(name)
            if isinstance(due, Failure):
                raise RobotError(due.why)
            yield due
            name = next(following, None)


def _attempt(make: Callable[[T], R], task: T) -> R | Failure:
    """The result of a task, or why there is none: a plug-in may raise anything."""
    try:
        return make(task)
    except ContactFusionError as error:
        return Failure(str(error))
    except Exception as error:
        return Failure(f"{type(error).__name__}: {error}")
