"""The doctor tells what is missing, and the one command that mends it."""

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import EntryPoint, PackageNotFoundError
from importlib.metadata import version as true_version
from pathlib import Path

import pytest

from contactfusion.doctor import installation, kernels
from contactfusion.doctor.installation import Finding
from contactfusion.extras import EXTRAS, extra_of, installs
from contactfusion.generators.networks import shipped
from contactfusion.plugins import Plugins

Said = Callable[[], str]


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Said:
    return lambda: capsys.readouterr().out


def without(monkeypatch: pytest.MonkeyPatch, *missing: str) -> None:
    def version(package: str) -> str:
        if package in missing:
            raise PackageNotFoundError(package)
        return true_version(package)

    monkeypatch.setattr(installation, "version", version)
    monkeypatch.setattr(installation, "_is_importable", lambda module: module not in missing)


def lines(report: str) -> list[str]:
    return [line.strip() for line in report.splitlines()]


# The whole report


def test_a_sound_installation_is_found_sound(said: Said) -> None:
    assert installation.check()
    report = said()
    for words in ("numba ", "plug-ins can be used", "kernels ", "networks: ", "Ouster files"):
        assert words in report
    assert "is missing" not in report


def test_it_imports_no_package_of_an_extra() -> None:
    modules = {module for extra in EXTRAS.values() for module in extra.values()} - {"safetensors"}
    code = (
        "import sys; from contactfusion.doctor.installation import check\n"
        f"check(); print({modules} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "set()"


@pytest.mark.parametrize("core", [True, False])
def test_only_a_fault_of_the_core_makes_it_unsound(
    core: bool, monkeypatch: pytest.MonkeyPatch, said: Said
) -> None:
    fault = Finding("the moon is gone", "fetch moon", core)
    monkeypatch.setattr(installation, "network_finding", lambda: fault)
    assert installation.check() is not core
    assert "the moon is gone: fetch moon" in lines(said())


# Packages


def test_a_missing_extra_is_no_fault_but_is_told_with_its_command(
    monkeypatch: pytest.MonkeyPatch, said: Said
) -> None:
    without(monkeypatch, "torch", "pyarrow")
    assert installation.check()
    report = said()
    assert "extra learn: not installed: pip install 'contactfusion[learn]'" in report
    assert "extra parquet: not installed: pip install 'contactfusion[parquet]'" in report
    assert "extra plot: installed" in report


def test_a_missing_core_package_is_a_fault(monkeypatch: pytest.MonkeyPatch, said: Said) -> None:
    without(monkeypatch, "scipy")
    assert not installation.check()
    assert "scipy is missing: pip install scipy" in lines(said())


def test_every_extra_that_users_can_install_is_looked_for() -> None:
    from importlib.metadata import metadata

    offered = set(metadata("contactfusion").get_all("Provides-Extra") or ())
    assert offered - {"all", "bench", "dev", "docs", "fuzz"} == set(EXTRAS)


def test_every_package_of_an_extra_is_one_that_the_extra_installs() -> None:
    from importlib.metadata import requires

    wanted = requires("contactfusion") or []
    for extra, brought in EXTRAS.items():
        asked = {one.partition(";")[0] for one in wanted if f'extra == "{extra}"' in one}
        for package in brought:
            assert any(one.startswith(package) for one in asked), f"{package} of {extra}"


def test_the_extra_of_a_module() -> None:
    assert extra_of("torch.nn.functional") == "learn"
    assert extra_of("cv2") == "vision"
    assert extra_of("numpy") is None
    assert installs("view") == "pip install 'contactfusion[view]'"


# Libraries of the system


def missing_libraries(monkeypatch: pytest.MonkeyPatch, *missing: str) -> list[str]:
    def load(name: str) -> object:
        if name in missing:
            raise OSError(f"{name}: cannot open shared object file: No such file or directory")
        return object()

    monkeypatch.setattr(ctypes, "CDLL", load)
    monkeypatch.setattr(
        installation, "_has_driver", lambda: installation.VULKAN_DRIVER not in missing
    )
    monkeypatch.setattr(installation, "_is_importable", lambda module: True)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    return [str(finding) for finding in installation.library_findings()]


def test_libraries_that_are_there_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert missing_libraries(monkeypatch) == [
        "system libraries: there for open3d, pin, view --screenshot"
    ]


def test_all_missing_libraries_are_one_line_to_run(monkeypatch: pytest.MonkeyPatch) -> None:
    gone = ("libEGL.so.1", "libusb-1.0.so.0", "libgomp.so.1", installation.VULKAN_DRIVER)
    assert missing_libraries(monkeypatch, *gone) == [
        "system libraries are missing, libEGL.so.1 (for open3d), libusb-1.0.so.0 (for open3d), "
        "libgomp.so.1 (for pin), a driver for Vulkan (for view --screenshot): "
        "sudo apt-get install -y libegl1 libusb-1.0-0 libgomp1 mesa-vulkan-drivers"
    ]


def test_root_needs_no_sudo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert installation.apt("libgl1") == "apt-get install -y libgl1"


def test_missing_libraries_are_no_fault_of_the_core(
    monkeypatch: pytest.MonkeyPatch, said: Said
) -> None:
    monkeypatch.setattr(installation, "_is_there", lambda library: library != "libGL.so.1")
    assert installation.check()
    assert "libGL.so.1 (for open3d)" in said()


def test_libraries_of_packages_that_are_not_installed_are_not_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(installation, "_is_there", lambda library: False)
    monkeypatch.setattr(installation, "_is_importable", lambda module: module == "pinocchio")
    (finding,) = installation.library_findings()
    assert "libgomp1" in finding.mend and "libgl1" not in finding.mend
    monkeypatch.setattr(installation, "_is_importable", lambda module: False)
    assert list(installation.library_findings()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere wheels bring what they need")
def test_a_library_is_found_as_the_loader_finds_it() -> None:
    assert installation._is_there("libc.so.6")
    assert not installation._is_there("libnothing-of-that-name.so.7")


def test_a_driver_for_vulkan_is_a_file_that_the_environment_or_a_folder_names(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(installation, "DRIVER_FOLDERS", (str(tmp_path),))
    for variable in installation.DRIVER_VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    assert not installation._is_there(installation.VULKAN_DRIVER)
    driver = tmp_path / "lvp_icd.x86_64.json"
    driver.write_text("{}")
    assert installation._is_there(installation.VULKAN_DRIVER)
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "other.json"))
    assert not installation._is_there(installation.VULKAN_DRIVER)
    monkeypatch.setenv("VK_DRIVER_FILES", str(driver))
    assert installation._is_there(installation.VULKAN_DRIVER)


def test_the_set_up_installs_the_libraries_that_the_doctor_asks_for() -> None:
    script = (Path(__file__).parents[1] / "scripts" / "setup.sh").read_text()
    for need in installation.NEEDS:
        if need.module in ("open3d", "pinocchio"):
            for library, debian in need.libraries.items():
                assert f"{library}:{debian}" in script


# Plug-ins


def point(name: str, module: str, package: str = "") -> EntryPoint:
    entry = EntryPoint(name, module, "contactfusion")
    if package:
        vars(entry)["dist"] = type("Distribution", (), {"name": package, "version": "1.2"})()
    return entry


def findings(*points: EntryPoint) -> list[Finding]:
    return list(installation.plugin_findings(Plugins(points=points)))


def test_a_broken_plugin_is_named_with_its_cause_and_is_no_fault_of_the_core(
    monkeypatch: pytest.MonkeyPatch, said: Said
) -> None:
    broken = Plugins(points=[point("bumper", "no_such_module", "cf-bumper")])
    monkeypatch.setattr(installation, "installed_plugins", lambda: broken)
    assert installation.check()
    assert (
        "plug-in bumper cannot be used: ModuleNotFoundError: No module named 'no_such_module'; "
        "mend it, or take it out: pip uninstall cf-bumper"
    ) in lines(said())


def test_a_plugin_of_ours_that_is_broken_is_a_fault_of_the_core() -> None:
    broken, count = findings(point("tactile", "no_such_module", "contactfusion"))
    assert broken.core and broken.mend == installation.AGAIN
    assert str(count) == "0 plug-ins can be used"


def test_a_plugin_that_lacks_an_extra_ends_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(sys.modules, "torch", None)
    (tmp_path / "cf_needs_torch.py").write_text("import torch\n")
    for package in ("contactfusion", "cf-other"):
        (lacking, _) = findings(point("deep", "cf_needs_torch", package))
        assert not lacking.core
        assert str(lacking).startswith("plug-in deep cannot be used: ModuleNotFoundError: ")
        assert str(lacking).endswith("; install it with: pip install 'contactfusion[learn]'")


def test_of_two_plugins_of_one_name_the_second_is_taken_out() -> None:
    ours, other = "contactfusion.generators.tactile", "cf_other"
    taken, count = findings(
        point("tactile", ours, "contactfusion"), point("tactile", other, "cf-other")
    )
    assert str(taken).startswith("plug-in tactile (cf-other 1.2) cannot be used: the name ")
    assert taken.mend == "pip uninstall cf-other" and not taken.core
    assert str(count) == "1 plug-ins can be used"


def test_what_no_package_brought_cannot_be_taken_out() -> None:
    (broken, _) = findings(point("loose", "no_such_module"))
    assert broken.mend == "" and not broken.core


# Networks


@pytest.mark.parametrize("fault", ["missing", "damaged", "other", "no card"])
def test_networks_that_are_not_those_of_the_card_are_a_fault(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / shipped().name
    for suffix in (".safetensors", ".json"):
        shutil.copy(shipped().with_suffix(suffix), path.with_suffix(suffix))
    monkeypatch.setattr(installation, "shipped", lambda: path)
    assert str(installation.network_finding()) == "networks: contact.safetensors is sound"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    if fault == "missing":
        path.unlink()
    elif fault == "no card":
        path.with_suffix(".json").unlink()
    else:
        path.write_bytes(content if fault == "other" else content[:1000])
    finding = installation.network_finding()
    assert finding.core and str(finding).endswith(f": {installation.AGAIN}")
    assert str(path.with_suffix("").name) in finding.text


# Kernels


def test_every_module_with_kernels_is_looked_at() -> None:
    root = Path(__file__).parents[1]
    found = set()
    for folder in ("contactfusion", "generators", "integrator", "controllers"):
        for path in (root / folder).rglob("*.py"):
            if "from contactfusion.jit import kernel" in path.read_text():
                name = ".".join(path.relative_to(root).with_suffix("").parts)
                found.add(name if folder == "contactfusion" else f"contactfusion.{name}")
    assert found == set(kernels.MODULES)


def test_warming_up_compiles_every_kernel_and_says_how_long_it_took(said: Said) -> None:
    installation.compile_kernels()
    assert "kernels are ready after" in said()
    for name in kernels.MODULES:
        for kernel in kernels.called(import_module(name)):
            assert kernel.signatures, f"{kernel.py_func.__name__} of {name}"
            assert kernels.is_kept(kernel)


def test_kernels_that_are_compiled_are_told_with_their_folder() -> None:
    kernels.touch_kernels()
    finding = installation.kernel_finding()
    assert finding.mend == "" and " kernels are compiled, in " in finding.text
    folder = finding.text.partition(" in ")[2].partition(" and ")[0]
    assert any(Path(folder).glob("*.nbi"))


def test_kernels_that_are_not_compiled_are_told_and_not_compiled(tmp_path: Path) -> None:
    code = (
        "from contactfusion.doctor.installation import kernel_finding\n"
        "finding = kernel_finding(); print(finding); assert not finding.core"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    said = done.stdout.strip()
    assert f"kernels are not compiled in {tmp_path}" in said
    assert said.endswith(": contactfusion doctor --warm")
    assert not list(tmp_path.rglob("*.nbi"))


def test_kernels_that_cannot_be_kept_are_a_fault() -> None:
    code = (
        "from contactfusion import jit\n"
        "from contactfusion.doctor import installation\n"
        "true = jit.njit\n"
        "def refused(function, cache=False, **options):\n"
        "    if cache: raise RuntimeError('no locator available')\n"
        "    return true(function, **options)\n"
        "jit.njit = refused\n"
        "finding = installation.kernel_finding(); print(finding); assert finding.core"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = done.stdout.strip()
    assert said.startswith("kernels cannot be kept on disk, and are compiled again by every ")
    assert ": export NUMBA_CACHE_DIR=/" in said


def test_a_folder_that_cannot_be_written_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    finding = installation.kernel_finding()
    assert finding.core and "cannot be kept on disk" in finding.text
    assert finding.mend.startswith("export NUMBA_CACHE_DIR=")
