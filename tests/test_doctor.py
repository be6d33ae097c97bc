"""The doctor tells what is missing, and the one command that mends it."""

from collections.abc import Callable
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as true_version
from typing import Any

import pytest

from contactfusion import doctor
from contactfusion.plugins import Plugins

Said = Callable[[], str]


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Said:
    return lambda: capsys.readouterr().out


def without(monkeypatch: pytest.MonkeyPatch, *packages: str) -> None:
    def version(package: str) -> str:
        if package in packages:
            raise PackageNotFoundError(package)
        return true_version(package)

    monkeypatch.setattr(doctor, "version", version)


def test_a_sound_installation_is_found_sound(said: Said) -> None:
    assert doctor.check()
    report = said()
    assert "numba " in report and "plug-ins can be used" in report and "kernels " in report
    assert "is missing" not in report


def test_a_missing_extra_is_no_fault_but_is_told_with_its_command(
    monkeypatch: pytest.MonkeyPatch, said: Said
) -> None:
    without(monkeypatch, "torch")
    assert doctor.check()
    assert "extra learn: not installed: pip install 'contactfusion[learn]'" in said()


def test_a_missing_core_package_is_a_fault(monkeypatch: pytest.MonkeyPatch, said: Said) -> None:
    without(monkeypatch, "scipy")
    assert not doctor.check()
    assert "scipy is missing: pip install scipy" in said()


def test_every_extra_that_users_can_install_is_looked_for() -> None:
    from importlib.metadata import metadata

    offered = set(metadata("contactfusion").get_all("Provides-Extra") or ())
    assert offered - {"all", "bench", "dev", "docs", "fuzz"} == set(doctor.EXTRAS)


def test_a_broken_plugin_is_a_fault_and_is_named(
    monkeypatch: pytest.MonkeyPatch, said: Said
) -> None:
    broken = Plugins(points=[_point("bumper", "no_such_module")])
    monkeypatch.setattr(doctor, "installed_plugins", lambda: broken)
    assert not doctor.check()
    assert "plug-in bumper cannot be used: ModuleNotFoundError" in said()


def test_a_kernel_that_cannot_be_kept_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, said: Said
) -> None:
    monkeypatch.setattr("contactfusion.integrator.store.merge", object())
    assert not doctor.check()
    assert "kernels cannot be kept on disk: set NUMBA_CACHE_DIR" in said()


def test_warming_up_says_how_long_it_took(said: Said) -> None:
    doctor.compile_kernels()
    assert "kernels are ready after" in said()


def _point(name: str, module: str) -> Any:
    from importlib.metadata import EntryPoint

    return EntryPoint(name, module, "contactfusion")
