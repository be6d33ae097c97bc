"""The cache of the compiled kernels: never stale, and not needed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import contactfusion.jit as jit

MODULE = """
from contactfusion_jit import kernel

@kernel
def inner(x: float) -> float:
    return x + 1.0

@kernel
def outer(x: float) -> float:
    return 10.0 * inner(x)
"""
USE = "import kernels; print(kernels.outer(1.0), sum(kernels.outer.stats.cache_hits.values()))"

LOOK = (
    "import kernels; from contactfusion.doctor.kernels import is_kept; "
    "kept = is_kept(kernels.outer); kernels.outer(1.0); "
    "print(int(kept), sum(kernels.outer.stats.cache_hits.values()))"
)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Give a folder with the decorator of the kernels and a module that uses it."""
    assert jit.__file__
    shutil.copy(jit.__file__, tmp_path / "contactfusion_jit.py")
    (tmp_path / "kernels.py").write_text(MODULE)
    return tmp_path


def run(folder: Path, code: str = USE, **environment: str) -> tuple[float, int]:
    """The number that code prints in a process of its own, and the hits of the cache."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    result, hits = done.stdout.split()
    return float(result), int(hits)


def test_an_edited_kernel_is_compiled_again_with_all_that_call_it(project: Path) -> None:
    cache = str(project / "cache")
    assert run(project, NUMBA_CACHE_DIR=cache) == (20.0, 0)
    assert run(project, NUMBA_CACHE_DIR=cache) == (20.0, 1)
    module = project / "kernels.py"
    module.write_text(MODULE.replace("x + 1.0", "x + 2.0"))
    later = module.stat().st_mtime_ns + 1_000_000_000
    os.utime(module, ns=(later, later))
    assert run(project, NUMBA_CACHE_DIR=cache) == (30.0, 0)


def test_the_doctor_finds_a_kernel_compiled_where_numba_does(project: Path) -> None:
    cache = str(project / "cache")
    assert run(project, LOOK, NUMBA_CACHE_DIR=cache) == (0.0, 0)
    assert run(project, LOOK, NUMBA_CACHE_DIR=cache) == (1.0, 1)
    module = project / "kernels.py"
    for text in (MODULE, MODULE.replace("x + 1.0", "x + 2.0")):
        later = module.stat().st_mtime_ns + 1_000_000_000  # as after a checkout
        module.write_text(text)
        os.utime(module, ns=(later, later))
        kept, hits = run(project, LOOK, NUMBA_CACHE_DIR=cache)
        assert kept == hits


def test_kernels_run_where_nothing_can_be_cached(project: Path) -> None:
    blocked = project / "file"
    blocked.touch()  # no folder can be made below a file, not even by root
    (project / "__pycache__").touch()
    places = {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked / "cache")}
    assert run(project, **places) == (20.0, 0)
    assert not list(project.rglob("*.nbi"))


def test_kernels_that_call_each_other_stand_in_one_module() -> None:
    from contactfusion.generators import lstm
    from contactfusion.integrator import clusters, kernels, moments, store

    for module in (clusters, kernels, lstm, moments, store):
        for name, thing in vars(module).items():
            if hasattr(thing, "py_func"):
                assert thing.py_func.__module__ == module.__name__, f"{name} in {module.__name__}"
