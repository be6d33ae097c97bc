"""The compiled kernels: their modules, the state of their cache, and a call of each."""

from collections.abc import Iterator, Sequence
from types import ModuleType
from typing import Any

MODULES = (
    "contactfusion.generators.lstm",
    "contactfusion.generators.motion",
    "contactfusion.generators.proximity",
    "contactfusion.generators.first_touch",
    "contactfusion.generators.torque_field",
    "contactfusion.integrator.cells",
    "contactfusion.integrator.clusters",
    "contactfusion.integrator.fields",
    "contactfusion.integrator.kernels",
    "contactfusion.integrator.moments",
    "contactfusion.integrator.nearby",
    "contactfusion.integrator.store",
    "contactfusion.nearest",
    "contactfusion.patches",
    "contactfusion.thinning",
)
"""All modules with kernels."""


def called(module: ModuleType) -> Iterator[Any]:
    """The kernels of a module that are not only called by other kernels, whose code holds them."""
    from numba.extending import is_jitted

    kernels: dict[str, Any] = {
        name: member
        for name, member in vars(module).items()
        if is_jitted(member) and member.py_func.__module__ == module.__name__
    }
    within = {name for kernel in kernels.values() for name in kernel.py_func.__code__.co_names}
    return (kernel for name, kernel in kernels.items() if name not in within)


def is_kept(kernel: Any) -> bool:
    """Whether numba has cached machine code of a kernel that is not stale."""
    return bool(kernel._cache._cache_file._load_index())  # numba has no public name for it


RULES = ("de_morgan", "sets")
"""The rules that have kernels."""


def touch_kernels(rules: Sequence[str] = RULES) -> None:
    """Call every kernel, so that it is compiled: one small cycle for each rule, and the rest.

    Args:
        rules: those whose kernels are needed.
    """
    import numpy as np

    positions = np.random.default_rng(0).uniform(-0.1, 0.1, (100, 3))
    _fuse(positions, rules)
    _perceive()
    _thin(positions)
    _slide(positions)
    _load(positions)


def _fuse(positions: Any, rules: Sequence[str]) -> None:
    import numpy as np

    from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
    from contactfusion.integrator.config import IntegratorConfig
    from contactfusion.integrator.integrator import Integrator
    from contactfusion.integrator.nearby import near
    from contactfusion.nearest import NearestGrid
    from contactfusion.surface import Surface

    NearestGrid.of(positions).improve(positions, np.eye(4), 0, np.ones(100), np.zeros(100, np.intp))
    near(positions, positions, 0.1)  # only explanations ask for it
    surface = Surface("base", positions, np.tile([0.0, 0.0, 1.0], (100, 1)))
    likelihoods, spreads = np.linspace(0.1, 0.9, 100), np.linspace(0.001, 0.01, 100)
    line = np.outer(np.linspace(0.0, 0.2, 100), [1.0, 0.0, 0.0])
    waves = 0.5 + 0.4 * np.cos(np.linspace(0.0, 20.0, 100))  # with peaks, and what is between them
    for rule in rules:
        integrator = Integrator(IntegratorConfig(rule=rule, expiry="voxel"))
        for source, stamp, places, given in (
            ("a", 0.0, positions, likelihoods),
            ("b", 0.0, line, waves),
            ("a", 0.1, positions, likelihoods),
        ):
            integrator.receive(
                HypothesisCloud(
                    source=source,
                    kind=HypothesisKind.REGULAR,
                    stamp=stamp,
                    frame="base",
                    positions=places,
                    likelihoods=given,
                    forces=positions,
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


def _thin(positions: Any) -> None:
    import numpy as np

    from contactfusion.generators.motion import moved
    from contactfusion.generators.proximity import BoxConfig
    from contactfusion.grid import Grid
    from contactfusion.patches import PatchConfig, TaxelAreas
    from contactfusion.thinning import voxel_downsample

    moved(positions, positions, voxel_downsample(positions, Grid("base", 0.1)))
    box = BoxConfig(x=(-0.1, 0.1), y=(-0.1, 0.1), z=(-0.1, 0.1))
    box.holds(positions)
    box.holds(positions.astype(np.float32))
    TaxelAreas(PatchConfig(places=((0.0, 0.0, 0.0),), size=(0.1, 0.1))).near(positions, 0.0)


def _slide(positions: Any) -> None:
    import numpy as np

    from contactfusion.generators.first_touch import DistanceGrid, Tufts, first_touches

    corner, nodes = np.full(3, -0.1), np.zeros((3, 3, 3), np.float32)
    grid = DistanceGrid(corner, -corner, corner, 0.1, nodes, 0.2)
    grid.distances(positions)
    up = np.array([0.0, 0.0, 1.0])
    first_touches(grid, Tufts.of(positions), np.zeros((1, 3)), np.eye(3)[None], up, 0.1, 0.0)


def _load(positions: Any) -> None:
    import numpy as np

    from contactfusion.generators.torque_field import explained

    axes, count = np.eye(3), len(positions)
    loads, up = np.ones((count, 3), np.bool_), np.tile([0.0, 0.0, 1.0], (count, 1))
    gains, evidence, forces = np.empty(count), np.empty(count), np.empty((count, 3))
    explained(
        positions, up, loads, 0.0 * axes, axes, np.ones(3), np.ones(3), 0.9, 1e-3,
        gains, evidence, forces,
    )  # fmt: skip
