"""Clouds told by voxel, and the step that they lead to."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from contactfusion import Fusion, HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from contactfusion.integrator.config import PARTS
from contactfusion.plugins import installed_plugins

REGULAR, SUPPORT, NULL = HypothesisKind.REGULAR, HypothesisKind.SUPPORT, HypothesisKind.NULL
SIDE = 0.005

Voxel = tuple[int, int, int]
Likelihoods = Mapping[Voxel, float] | Sequence[tuple[Voxel, float]]
OPTIONS = {"floor", "friction", "min_voxels", "existence"}
"""Of the built-in rules and condensations."""
HERE: Voxel = (0, 0, 0)
THERE: Voxel = (40, 0, 0)


def centres(voxels: Iterable[Voxel], side: float = SIDE) -> FloatArray:
    """Give the places of voxels, shape (n, 3) [m]."""
    return (np.array(list(voxels), np.float64).reshape(-1, 3) + 0.5) * side


def cloud(
    source: str,
    stamp: float,
    likelihoods: Likelihoods,
    kind: HypothesisKind = REGULAR,
    side: float = SIDE,
    **others: Any,
) -> HypothesisCloud:
    """Give a cloud with its hypotheses at the centres of voxels; in pairs, one may come twice."""
    pairs = list(likelihoods.items() if isinstance(likelihoods, Mapping) else likelihoods)
    fields: dict[str, Any] = {
        "source": source,
        "kind": kind,
        "stamp": stamp,
        "frame": "base",
        "positions": centres((voxel for voxel, _ in pairs), side),
        "likelihoods": np.array([p for _, p in pairs]),
    }
    return HypothesisCloud(**{**fields, **others})


def law(**fields: Any) -> IntegratorConfig:
    """A configuration, with options beside the names of rule and condensation that have them."""
    named = IntegratorConfig(**{part: fields[part] for part in PARTS if part in fields})
    parts: dict[str, Any] = {}
    for part in PARTS:
        cls = installed_plugins().find(f"{part}s", name := getattr(named, part))
        own = {key: fields.pop(key) for key in cls.Config.model_fields if key in fields}
        parts[part] = {"type": name, **own}
    assert fields.keys() <= IntegratorConfig.model_fields.keys() | OPTIONS, fields
    rest = {key: value for key, value in fields.items() if key not in OPTIONS}
    return IntegratorConfig(**{**rest, **parts})


def fused(*clouds: HypothesisCloud, now: float = 0.0, **config: Any) -> Fusion:
    """Fuse clouds in one step of a new integrator."""
    integrator = Integrator(law(**config))
    for one in clouds:
        integrator.receive(one)
    return integrator.step(now)


def by_voxel(fusion: Fusion) -> dict[Voxel, float]:
    """Give the fused likelihoods."""
    return dict(zip(voxels_of(fusion), fusion.space.likelihoods.tolist(), strict=True))


def verdicts(fusion: Fusion) -> dict[Voxel, str]:
    """Give what was decided about each voxel."""
    return dict(zip(voxels_of(fusion), map(str, fusion.space.verdicts), strict=True))


def given(fusion: Fusion, source: str) -> dict[Voxel, float]:
    """Give the living likelihoods of one source."""
    column = fusion.space.source_likelihoods[:, fusion.space.sources.index(source)].tolist()
    return {v: p for v, p in zip(voxels_of(fusion), column, strict=True) if p == p}


def voxels_of(fusion: Fusion) -> list[Voxel]:
    """Give the voxels in order."""
    return [(x, y, z) for x, y, z in fusion.space.voxels.tolist()]


def contents(fusion: Fusion) -> tuple[Any, ...]:
    """Give all that a step says, but for its report, so that two steps can be compared to the byte.

    Sources that have nothing to say are left out.
    """
    space = fusion.space
    speaks = np.flatnonzero(~np.isnan(space.source_likelihoods).all(axis=0))
    names = tuple(space.sources[source] for source in speaks)
    arrays = (
        space.voxels,
        space.positions,
        space.likelihoods,
        space.source_likelihoods[:, speaks],
        space.forces,
        space.stamps,
    )
    return (
        space.frame,
        names,
        tuple(array.tobytes() for array in arrays),
        tuple(space.verdicts.tolist()),
        tuple(
            (
                contact.position.tobytes(),
                contact.likelihood,
                contact.dispersion,
                contact.covariance.tobytes(),
                contact.extent.tobytes(),
                contact.force.tobytes(),
                contact.voxels,
                tuple((name, contact.shares[name]) for name in names if name in contact.shares),
                contact.stamp,
                contact.frame,
            )
            for contact in fusion.contacts
        ),
    )
