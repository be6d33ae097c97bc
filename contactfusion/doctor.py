"""Checks an installation, and says the one command that mends each fault."""

import sys
import time
from importlib.metadata import PackageNotFoundError, requires, version

from contactfusion.plugins import installed_plugins
from contactfusion.recordings import ouster

EXTRAS = {
    "plot": ("matplotlib",),
    "robot": ("pin", "open3d"),
    "sim": ("pybullet", "gymnasium"),
    "learn": ("torch", "safetensors"),
    "vision": ("opencv-python-headless", "open3d"),
    "sam": ("transformers",),
    "record": ("rosbags", "pytransform3d"),
    "view": ("rerun-sdk",),
    "ros2": ("cyclonedds",),
    "zenoh": ("eclipse-zenoh",),
    "c3d": ("ezc3d",),
    "cluster": ("distributed",),
    "calibrate": ("scikit-learn",),
}
"""The packages that each extra is for."""


def check() -> bool:
    """Print the state of the installation.

    Returns:
        Whether all that the core needs is there; a missing extra is no fault.
    """
    print(f"python {sys.version.split()[0]}, contactfusion {version('contactfusion')}")
    sound = True
    for requirement in requires("contactfusion") or []:
        if "extra ==" not in requirement:
            name = requirement.split(">")[0].split("=")[0].strip()
            found = _version(name)
            sound = sound and found is not None
            print(f"  {name} {found or 'is missing: pip install ' + name}")
    for extra, packages in EXTRAS.items():
        missing = [name for name in packages if _version(name) is None]
        state = f"not installed: pip install 'contactfusion[{extra}]'" if missing else "installed"
        print(f"  extra {extra}: {state}")
    converts = f"can be converted: {ouster.CONVERT}"
    print(f"  Ouster files {converts if ouster.is_ready() else f'need: {ouster.COMMAND}'}")
    return _check_plugins() and _check_kernels() and sound


def compile_kernels() -> None:
    """Compile every kernel, so that no control loop ever waits for the compiler."""
    print("compiling kernels (half a minute, once) ...", flush=True)
    start = time.perf_counter()
    _touch_kernels()
    print(f"kernels are ready after {time.perf_counter() - start:.1f} s")


def _check_plugins() -> bool:
    plugins = installed_plugins()
    plugins.offers("generators")
    for name, why in plugins.failures.items():
        print(f"  plug-in {name} cannot be used: {why}")
    print(f"  {len(plugins.listing()) - len(plugins.failures)} plug-ins can be used")
    return not plugins.failures


def _check_kernels() -> bool:
    from contactfusion.integrator.store import merge

    cached = getattr(merge, "stats", None)
    folder = getattr(cached, "cache_path", None)
    if folder is None:
        print("  kernels cannot be kept on disk: set NUMBA_CACHE_DIR to a folder you may write")
        return False
    start = time.perf_counter()
    _touch_kernels()
    took = time.perf_counter() - start
    slow = took > 5.0
    print(f"  kernels {'were compiled' if slow else 'loaded'} in {took:.1f} s, kept in {folder}")
    return True


def _touch_kernels() -> None:
    """Run a small cycle through every rule, condensation and expiry."""
    import numpy as np

    from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
    from contactfusion.integrator.config import IntegratorConfig
    from contactfusion.integrator.integrator import Integrator
    from contactfusion.nearest import NearestGrid
    from contactfusion.simulation.planar import PlanarPush
    from contactfusion.simulation.push_config import PushConfig

    push = PlanarPush(PushConfig(target=(1.0, 0.0)))
    push.drive(0.1, 0.0, 0.0)
    assert push.contacts()
    places = np.random.default_rng(0).uniform(-0.1, 0.1, (100, 3))
    NearestGrid.of(places).improve(places, np.eye(4), 0, np.ones(100), np.zeros(100, np.intp))
    regular = HypothesisKind.REGULAR
    for rule in ("de_morgan", "max", "log_odds", "dempster_shafer"):
        config = IntegratorConfig(rule=rule, expiry="voxel", condensation="cluster_mass")
        integrator = Integrator(config)
        for stamp in (0.0, 0.1):
            cloud = HypothesisCloud("a", regular, stamp, "base", places, np.full(100, 0.5), places)
            integrator.receive(cloud)
            fusion = integrator.step(stamp)
            assert len(fusion.space.voxels)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
