"""The demo: three sources that disagree about where a gripper touches."""

from pathlib import Path

import numpy as np

from contactfusion.explain import explain
from contactfusion.figures import draw_fusion
from contactfusion.files import make_folder
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.integrator.integrator import Integrator

STAMP = 1.0


def sources() -> list[HypothesisCloud]:
    """Give what a skin, a force-torque sensor and a camera believe at one instant.

    The skin feels one touch, well placed. The wrench has a line of action: the contact lies where
    it enters the palm or where it leaves. The camera sees an object near the touch, and free space
    around the palm's other side.
    """
    skin = np.array([[0.041, 0.002, 0.0], [0.046, 0.002, 0.0], [0.041, 0.007, 0.0]])
    line = np.array([[0.045 - 0.08 * s, 0.004 + 0.06 * s, 0.0] for s in (0.0, 0.06, 1.0, 1.06)])
    x, y = np.meshgrid(np.arange(0.03, 0.06, 0.005), np.arange(-0.01, 0.02, 0.005))
    seen = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + 0.001
    near = np.linalg.norm(seen - [0.05, 0.01, 0.0], axis=1)
    free = line[2:]
    regular, support, null = HypothesisKind.REGULAR, HypothesisKind.SUPPORT, HypothesisKind.NULL
    return [
        HypothesisCloud("skin", regular, STAMP, "palm", skin, np.array([0.9, 0.5, 0.4])),
        HypothesisCloud("wrench", regular, STAMP, "palm", line, np.full(4, 0.25), single=True),
        HypothesisCloud("camera", support, STAMP, "palm", seen, 1e-4 / (1e-4 + near**2)),
        HypothesisCloud("camera/free", null, STAMP, "palm", free, np.ones(2)),
    ]


def show(out: Path) -> None:
    """Fuse the three sources, print the contacts with their reasons, draw a picture."""
    integrator = Integrator(IntegratorConfig(frame="palm"))
    for cloud in sources():
        integrator.receive(cloud)
    fusion = integrator.step(STAMP)
    make_folder(out)
    print(explain(fusion))
    print(f"picture: {draw_fusion(fusion, out / 'contacts.png')}")
