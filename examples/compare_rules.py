"""Six situations, each fused by the default rule and by De Morgan, as in docs/rules.md.

Run it with `python examples/compare_rules.py [FOLDER]`; it needs the extra `plot`. Positions in mm.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import contactfusion as cf

METHODS = {"default": {}, "De Morgan": {"rule": "de_morgan"}}
VIEW = dict(aspect="equal", xlim=(-52, 52), ylim=(-42, 42), xlabel="x [mm]", ylabel="y [mm]")
PALM = cf.ShapeConfig(shape="rectangle", size=(0.1, 0.08)).sampled("hand", 0.004)
FINGERS = cf.Surface.joined([cf.ShapeConfig(shape="cylinder", radius=0.012, length=0.06,
    xyz=(x, 0.0, 0.0)).sampled("hand", 0.004) for x in (-0.022, 0.022)])  # fmt: skip
CIRCLE = np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 60)]).T


def emit(source: str, kind: Any, spread: float, p: Any, mm: Any, **more: Any) -> cf.HypothesisCloud:
    """A cloud of a source: positions [mm], likelihoods and spreads [mm]."""
    at = np.array(mm, np.float64).reshape(-1, 3) / 1e3
    likelihoods, spreads = np.broadcast_to(p, len(at)), np.full(len(at), spread / 1e3)
    return cf.HypothesisCloud(source, kind, 1.0, "hand", at, likelihoods, spreads=spreads, **more)


SKIN = emit("skin", "regular", 4.0, (0.9, 0.5, 0.4), [(0, 1, 0), (5, 1, 0), (0, 6, 0)])
ENDS = [(x + (144 - y * y) ** 0.5, y, z) for x in (-22, 22) for y in (-1, 4, 9) for z in (-2, 2)]
PRESSES = np.array([(-35, -25, 0), (-20, 20, 0), (15, -10, 0), (35, 25, 0)])
PATCH = np.array([(x, y, 0) for x in (-5, 0, 5) for y in (-5, 0, 5)])  # a position a voxel
FOUR, TOP = PRESSES[:, None] + PATCH / 2, PATCH + (20, 10, 0)
FACE = [(x, y, 0) for x in (-25, -15, -5, 5, 15, 25) for y in (-10, 0, 10)]  # taxels
SITUATIONS: dict[str, tuple[str, Any, Any, Any]] = {
    "apart": ("a skin and a camera never meet in a voxel", PALM, [(0, 3, 0)], [
        SKIN, emit("camera", "regular", 12.0, 0.4, PATCH + (18, 8, 0))]),
    "line": ("a line of force meets two fingers", FINGERS, [(33.3, 4, 0)], [
        emit("force", "regular", 4.0, 0.9 / 12, ENDS, single=True, forces=[(-8, 0, 0)] * 12),
        emit("prediction", "support", 15.0, 0.4, PATCH + (42, 10, 0))]),
    "stuck": ("a taxel is stuck, a camera and a wrist agree", PALM, [(20, 8, 0)], [
        emit("skin", "regular", 4.0, 0.95, [(-30, -20, 0)]),
        emit("camera", "regular", 12.0, 0.4, PATCH + (28, 14, 0)),
        emit("wrist", "regular", 6.0, 0.1, TOP, single=True, forces=[(0, 0, -8)] * 9)]),
    "free": ("a camera sees free space at a touch", PALM, [(0, 3, 0)], [
        SKIN, emit("camera", "null", 4.0, 0.6, PATCH + (5, 2, 0))]),
    "many": ("four presses", PALM, PRESSES, [emit("skin", "regular", 4.0, 0.8, FOUR)]),
    "face": ("a flat face pushes", PALM, [(0, 0, 0)], [emit("skin", "regular", 5.0, 0.9, FACE)]),
}  # fmt: skip


def fuse(name: str, how: str, without: str = "", **config: Any) -> cf.Fusion:
    """Fuse a situation, and print the likelihood of each contact and its distance from a touch."""
    _, surface, touches, clouds = SITUATIONS[name]
    integrator = cf.Integrator(cf.IntegratorConfig(frame="hand", **config))
    for cloud in (each for each in clouds if each.source != without):
        integrator.receive(cloud)
    fusion = integrator.step(1.0, surface)
    rows = [f"{c.likelihood:.2f} ({np.hypot(*(c.position * 1e3 - touches).T[:2]).min():.0f} mm off)"
            for c in fusion.contacts]  # fmt: skip
    print(f"  {how:12s} {', '.join(rows) or 'no contact'}")
    return fusion


def draw(name: str, path: Path) -> None:
    """Draw the clouds of the sources, and the voxels and contacts of each method, from above."""
    _, surface, touches, clouds = SITUATIONS[name]
    panels = (figure := Figure((10.5, 4.2), layout="constrained")).subplots(1, 3, subplot_kw=VIEW)
    for number, cloud in enumerate(clouds):
        label = f"{cloud.source}, {cloud.kind}, {cloud.spreads[0] * 1e3:.0f} mm"
        panels[0].scatter(*cloud.positions[:, :2].T * 1e3, s=9 + 70 * cloud.likelihoods,
            c=f"C{number}", marker="x" if cloud.kind == "null" else "o", label=label)  # fmt: skip
    for axes, (how, config) in zip(panels[1:], METHODS.items(), strict=True):
        fusion = fuse(name, how, **config)
        voxels = fusion.space.positions[:, :2] * 1e3
        axes.scatter(*voxels.T, c=fusion.space.likelihoods, marker="s", vmin=0, vmax=1)
        axes.plot(*voxels[fusion.space.verdicts == "nulled"].T, "wx", ms=5)
        for number, c in enumerate(fusion.contacts, 3):
            ring = c.position[:2, None] + 2.0 * np.linalg.cholesky(c.covariance[:2, :2]) @ CIRCLE
            axes.plot(*ring * 1e3, f"C{number}", lw=2, label=f"contact, {c.likelihood:.2f}")
            axes.plot(*c.extent.T[:2] * 1e3, f"C{number}.-")
    for axes, heading in zip(panels, ("what each source says", *METHODS), strict=True):
        axes.scatter(*surface.points[:, :2].T * 1e3, s=1, c="#bbbbbb", zorder=0)
        axes.plot(*np.transpose(touches)[:2], "k*", mfc="none", ms=13, label="touch")
        axes.set_title(heading)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), ncols=2, fontsize="small")
    figure.colorbar(panels[-1].collections[0], ax=panels, shrink=0.6, label="likelihood of a voxel")
    figure.savefig(path, dpi=80, bbox_inches="tight")


out = Path(sys.argv[1] if len(sys.argv) > 1 else "out/compare_rules")
out.mkdir(parents=True, exist_ok=True)
for name, (title, *_) in SITUATIONS.items():
    print(title)
    draw(name, out / f"rules_{name}.png")
for name, source in (("stuck", "wrist"), ("line", "prediction")):
    for how, config in METHODS.items():
        fuse(name, f"{name} without the {source}, {how}", source, **config)
