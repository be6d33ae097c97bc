"""Fuse by hand the hypotheses of a skin, a force-torque sensor and a camera on a gripper's touch.

Run it with `python examples/fuse_by_hand.py [FOLDER]`; the picture needs the extra `plot`.
"""

import sys
from pathlib import Path

import numpy as np

import contactfusion as cf

STAMP = 1.0
regular, support = cf.HypothesisKind.REGULAR, cf.HypothesisKind.SUPPORT
null = cf.HypothesisKind.NULL

# The skin reports one touch, well localized.
touched = np.array([[0.041, 0.002, 0.0], [0.046, 0.002, 0.0], [0.041, 0.007, 0.0]])
skin = cf.HypothesisCloud("skin", regular, STAMP, "palm", touched, np.array([0.9, 0.5, 0.4]))

# A wrench has a line of action: the contact lies where it enters the palm, or where it leaves.
line = np.array([[0.045 - 0.08 * s, 0.004 + 0.06 * s, 0.0] for s in (0.0, 0.06, 1.0, 1.06)])
wrench = cf.HypothesisCloud("wrench", regular, STAMP, "palm", line, np.full(4, 0.25), single=True)

# The camera sees an object near the touch, and free space at the palm's other side.
x, y = np.meshgrid(np.arange(0.03, 0.06, 0.005), np.arange(-0.01, 0.02, 0.005))
seen = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + 0.001
near = np.linalg.norm(seen - [0.05, 0.01, 0.0], axis=1)
camera = cf.HypothesisCloud("camera", support, STAMP, "palm", seen, 1e-4 / (1e-4 + near**2))
free = cf.HypothesisCloud("camera/free", null, STAMP, "palm", line[2:], np.ones(2))

# De Morgan can be checked by hand: 1 - (1 - p)(1 - q)..., and free space forbids.
integrator = cf.Integrator(cf.IntegratorConfig(frame="palm", rule="de_morgan"))
for cloud in (skin, wrench, camera, free):
    integrator.receive(cloud)
fusion = integrator.step(STAMP)

# Each contact has the shares of its sources; the explanation has what remains without each.
print(cf.explain_fusion(fusion))
print(f"without free space: {len(fusion.without('camera/free').contacts)} contacts")

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/fuse_by_hand")
folder.mkdir(parents=True, exist_ok=True)
cf.plot_fusion(fusion).savefig(folder / "contacts.png", dpi=120)
print(f"picture: {folder / 'contacts.png'}")
