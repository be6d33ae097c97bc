"""A package of a stranger, installed beside contactfusion."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"


class Stranger:
    """An environment of its own that has a package installed and borrows everything else.

    Args:
        package: the folder of the package.
        folder: where the environment goes.
    """

    def __init__(self, package: Path, folder: Path) -> None:
        self.source, self.home = folder / "package", folder / "env"
        shutil.copytree(package, self.source, ignore=shutil.ignore_patterns("build", "*.egg-info"))
        venv.create(self.home, symlinks=True)
        paths = {"base": str(self.home), "platbase": str(self.home)}
        site = Path(sysconfig.get_path("purelib", scheme="venv", vars=paths))
        borrowed = sysconfig.get_path("purelib")
        (site / "borrowed.pth").write_text(f"import site; site.addsitedir({borrowed!r})\n")
        self.python = self.home / "bin" / "python"
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
        offline = ["--no-deps", "--no-index"]
        wheels = ["--wheel-dir", str(folder), "--no-build-isolation", str(self.source)]
        subprocess.run([*pip, "wheel", *offline, *wheels], check=True)
        (wheel,) = folder.glob("*.whl")
        target = ["--python", str(self.python), "install"]
        subprocess.run([*pip, *target, *offline, str(wheel)], check=True)

    def run(self, *arguments: str) -> str:
        """What Python prints, run in the folder of the package."""
        given = {
            **os.environ,
            "COLUMNS": "200",
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "PYTHONPATH": f"{ROOT}:{ROOT / 'lab'}",
        }
        done = subprocess.run(
            [str(self.python), *arguments],
            capture_output=True,
            text=True,
            cwd=self.source,
            env=given,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def command(self, *arguments: str) -> str:
        """What a command of contactfusion prints."""
        return self.run("-m", "contactfusion", *arguments)
