"""Runs those slow tests of the laboratory that stand on what changed, and says how it decides.

A file of tests stands on itself, on the modules that it imports, directly or not, and on those of
all plug-ins, which configurations choose by name; if it starts other programs, on all modules but
those of tests. A changed file that is no module, such as a robot or the set-up, may matter to any
test, but for the pages. Where there is no commit to compare with, everything runs.

usage: changed.py [--since REV] [-- OPTION ...]   (default: where HEAD left origin/main)
"""

import argparse
import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "benchmarks": "benchmarks",
    "contactfusion": "contactfusion",
    "controllers": "contactfusion.controllers",
    "generators": "contactfusion.generators",
    "integrator": "contactfusion.integrator",
    "lab/contactfusion_lab": "contactfusion_lab",
    "lab/tests": "lab.tests",
    "scripts": "scripts",
    "tests": "tests",
}
"""The folders with modules, and the packages that they are."""
LANDED = "origin/main"
SLOW = "pytest.mark.slow"


def module_files(root: Path = ROOT) -> dict[str, str]:
    """The file of each module, from the root of the repository; links are not followed."""
    found = dict[str, str]()
    for folder, package in PACKAGES.items():
        for path in sorted((root / folder).rglob("*.py")):
            inside = path.relative_to(root / folder).with_suffix("").parts
            if not any(parent.is_symlink() for parent in path.parents):
                name = ".".join((package, *inside)).removesuffix(".__init__")
                found[name] = path.relative_to(root).as_posix()
    return found


def imports(name: str, source: str, modules: Iterable[str]) -> set[str]:
    """The modules that a module names, with the packages above them.

    Args:
        name: of the module.
        source: its text.
        modules: all that there are; a name in quotes is taken for one that is imported late.
    """
    started = set[str]()
    if _is_test(name) and "subprocess" in source:
        started = {module for module in modules if not _is_test(module)}
    parts = [named.split(".") for named in _names(ast.parse(source))]
    above = {".".join(words[:end]) for words in parts for end in range(1, len(words) + 1)}
    return above.intersection(modules) | started


def reached(starts: Iterable[str], graph: Mapping[str, Iterable[str]]) -> set[str]:
    """Modules with all that they import, directly or not."""
    found, waiting = set[str](), [*starts]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += graph[name]
    return found


def causes(
    tests: Iterable[str],
    changed: Iterable[str],
    files: Mapping[str, str],
    graph: Mapping[str, Iterable[str]],
    plugins: Iterable[str],
) -> dict[str, str]:
    """Why files of tests have to run.

    Args:
        tests: modules of tests.
        changed: files that changed; some may be gone.
        files: the file of each module.
        graph: the modules that each module imports.
        plugins: the modules of plug-ins.

    Returns:
        The changed file that is to blame, by module of tests; no entry for tests that may be left
        out.
    """
    harmless = {path for path in changed if path.startswith("docs/") or path.endswith(".md")}
    matter = sorted(set(changed) - harmless)
    unplaced = [path for path in matter if path not in files.values()]
    found = dict[str, str]()
    for test in tests:
        ground = {files[name] for name in reached((test, *plugins), graph)}
        blamed = unplaced or [path for path in matter if path in ground]
        if blamed:
            found[test] = blamed[0]
    return found


def base_of(since: str | None, root: Path = ROOT) -> str | None:
    """The commit to compare with; None: there is none.

    HEAD itself is none: what is landed already tells nothing of what came with it.

    Raises:
        CalledProcessError: `since` is no commit.
    """
    if since:
        return _git(root, "rev-parse", "--verify", f"{since}^{{commit}}")
    try:
        base = _git(root, "merge-base", "HEAD", LANDED)
    except (subprocess.CalledProcessError, FileNotFoundError):  # no branch, repository or git
        return None
    return None if base == _git(root, "rev-parse", "HEAD") else base


def changed_files(base: str, root: Path = ROOT) -> set[str]:
    """The files that differ from a commit, also those that are not committed, or gone."""
    differ = _git(root, "diff", "--name-only", "--no-renames", "-z", base)
    fresh = _git(root, "ls-files", "--others", "--exclude-standard", "-z")
    return set(filter(None, f"{differ}\0{fresh}".split("\0")))


def report(tests: Sequence[str], why: Mapping[str, str], files: Mapping[str, str]) -> Iterator[str]:
    """What runs and what is left out, with the reason, line by line."""
    for test in tests:
        ground = "nothing that it stands on changed"
        run = f"runs: {why[test]} changed" if test in why else f"LEFT OUT: {ground}"
        yield f"  {files[test]} {run}"
    yield f"slow tests: {len(why)} of {len(tests)} files run"


def main(since: str | None, options: Sequence[str]) -> int:
    """Decide, say how, and run.

    Args:
        since: the commit to compare with; None: where HEAD left origin/main.
        options: of pytest.

    Returns:
        The exit status of pytest; 0 when nothing has to run.
    """
    files = module_files()
    texts = {name: (ROOT / path).read_text() for name, path in files.items()}
    slow = [name for name in files if name.startswith("lab.tests.") and SLOW in texts[name]]
    base = base_of(since)
    if base is None:
        print(f"slow tests: all run, for there is no commit where HEAD left {LANDED}", flush=True)
        why = dict.fromkeys(slow, "")
    else:
        changed = changed_files(base)
        graph = {name: imports(name, text, files) for name, text in texts.items()}
        why = causes(slow, changed, files, graph, _plugins())
        print(f"slow tests: {len(changed)} files differ from {base} ({since or LANDED})")
        print(*report(slow, why, files), sep="\n", flush=True)
    if not why:
        return 0
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-m",
        "slow",
        *options,
        *(files[name] for name in why),
    ]
    return subprocess.run(command, cwd=ROOT).returncode


def _is_test(module: str) -> bool:
    return "tests" in module.split(".")


def _names(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=str(module), names=names):
                yield from (f"{module}.{alias.name}" for alias in names)
            case ast.Constant(value=str(text)):
                yield text


def _plugins() -> set[str]:
    """The modules of the entry points of framework and laboratory."""
    found = set[str]()
    for path in (ROOT / "pyproject.toml", ROOT / "lab" / "pyproject.toml"):
        points = tomllib.loads(path.read_text())["project"]["entry-points"]["contactfusion"]
        found.update(str(value).partition(":")[0] for value in points.values())
    return found


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=root, check=True, stdout=subprocess.PIPE, text=True)
    return done.stdout.strip()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--since", metavar="REV", help=f"default: where HEAD left {LANDED}")
    parser.add_argument("options", nargs="*", metavar="OPTION", help="of pytest, after --")
    arguments = parser.parse_args()
    sys.exit(main(arguments.since or None, arguments.options))
