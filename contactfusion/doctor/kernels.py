"""The compiled kernels: which there are, whether their machine code is kept, and a call of each."""

from collections.abc import Iterator
from types import ModuleType
from typing import Any

MODULES = (
    "contactfusion.generators.lstm",
    "contactfusion.generators.motion",
    "contactfusion.generators.proximity",
    "contactfusion.generators.first_touch",
    "contactfusion.integrator.clusters",
    "contactfusion.integrator.fields",
    "contactfusion.integrator.kernels",
    "contactfusion.integrator.moments",
    "contactfusion.integrator.store",
    "contactfusion.nearest",
    "contactfusion.patches",
    "contactfusion.thinning",
)
"""All that hold kernels."""


def called(module: ModuleType) -> Iterator[Any]:
    """The kernels of a module that are not only called by other kernels, which hold them."""
    from numba.extending import is_jitted

    kernels: dict[str, Any] = {
        name: thing
        for name, thing in vars(module).items()
        if is_jitted(thing) and thing.py_func.__module__ == module.__name__
    }
    within = {name for one in kernels.values() for name in one.py_func.__code__.co_names}
    return (kernel for name, kernel in kernels.items() if name not in within)


def is_kept(kernel: Any) -> bool:
    """Whether numba takes machine code of a kernel from its cache: it knows when that is stale."""
    return bool(kernel._cache._cache_file._load_index())  # no public name tells


def touch_kernels() -> None:
    """Call every kernel, so that it is compiled: a small cycle through every rule and the rest."""
    import numpy as np

    places = np.random.default_rng(0).uniform(-0.1, 0.1, (100, 3))
    _fuse(places)
    _perceive()
    _thin(places)
    _slide(places)


def _fuse(places: Any) -> None:
    import numpy as np

    from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
    from contactfusion.integrator.config import IntegratorConfig
    from contactfusion.integrator.integrator import Integrator
    from contactfusion.nearest import NearestGrid
    from contactfusion.surface import Surface

    NearestGrid.of(places).improve(places, np.eye(4), 0, np.ones(100), np.zeros(100, np.intp))
    surface = Surface("base", places, np.tile([0.0, 0.0, 1.0], (100, 1)))
    likelihoods, spreads = np.linspace(0.1, 0.9, 100), np.linspace(0.001, 0.01, 100)
    for rule in ("de_morgan", "max", "log_odds", "dempster_shafer", "posterior"):
        condensation = "modes" if rule == "posterior" else "cluster_mass"
        integrator = Integrator(
            IntegratorConfig(rule=rule, expiry="voxel", condensation=condensation)
        )
        for source, stamp in (("a", 0.0), ("b", 0.0), ("a", 0.1)):
            integrator.receive(
                HypothesisCloud(
                    source=source,
                    kind=HypothesisKind.REGULAR,
                    stamp=stamp,
                    frame="base",
                    positions=places,
                    likelihoods=likelihoods,
                    forces=places,
                    spreads=spreads,
                )
            )
            assert len(integrator.step(stamp, surface).space.voxels)


def _perceive() -> None:
    import numpy as np

    from contactfusion.generators.lstm import Network, tensor_shapes

    shapes = tensor_shapes(columns=1, outputs=1)
    weights = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    Network.of(weights).outputs(np.zeros((1, 1)))


def _thin(places: Any) -> None:
    import numpy as np

    from contactfusion.generators.motion import moved
    from contactfusion.generators.proximity import BoxConfig
    from contactfusion.grid import Grid
    from contactfusion.patches import PatchConfig, TaxelAreas
    from contactfusion.thinning import first_in_voxels

    moved(places, places, first_in_voxels(places, Grid("base", 0.1)))
    box = BoxConfig(x=(-0.1, 0.1), y=(-0.1, 0.1), z=(-0.1, 0.1))
    box.holds(places)
    box.holds(places.astype(np.float32))
    TaxelAreas(PatchConfig(places=((0.0, 0.0, 0.0),), size=(0.1, 0.1))).near(places, 0.0)


def _slide(places: Any) -> None:
    import numpy as np

    from contactfusion.generators.first_touch import DistanceGrid, Tufts, first_touches

    corner, nodes = np.full(3, -0.1), np.zeros((3, 3, 3), np.float32)
    grid = DistanceGrid(corner, -corner, corner, 0.1, nodes, 0.2)
    grid.distances(places)
    up = np.array([0.0, 0.0, 1.0])
    first_touches(grid, Tufts.of(places), np.zeros((1, 3)), np.eye(3)[None], up, 0.1, 0.0)
