"""Three sources that disagree: fuse them, ask why, draw a picture.

Run it with `python examples/quickstart.py [FOLDER]`.
"""

import sys
from pathlib import Path

import numpy as np

import contactfusion as cf

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out/quickstart")
regular, support = cf.HypothesisKind.REGULAR, cf.HypothesisKind.SUPPORT
null = cf.HypothesisKind.NULL

# The skin feels one touch over three taxels.
skin = cf.HypothesisCloud(
    source="skin",
    kind=regular,
    stamp=1.0,
    frame="palm",
    positions=np.array([[0.041, 0.002, 0.0], [0.046, 0.002, 0.0], [0.041, 0.007, 0.0]]),
    likelihoods=np.array([0.9, 0.5, 0.4]),
)

# The wrench knows one line of action: the contact lies where it enters the palm, or leaves it.
ends = np.array([[0.045, 0.004, 0.0], [0.040, 0.008, 0.0], [-0.035, 0.064, 0.0]])
wrench = cf.HypothesisCloud("wrench", regular, 1.0, "palm", ends, np.full(3, 1 / 3), single=True)

# The camera predicts a contact near the object that it sees, and rules one out where it sees none.
object_near = np.array([[0.041, 0.002, 0.0], [0.046, 0.007, 0.0], [0.051, 0.007, 0.0]])
camera = cf.HypothesisCloud("camera", support, 1.0, "palm", object_near, np.array([0.5, 0.7, 0.9]))
free = cf.HypothesisCloud("camera/free", null, 1.0, "palm", ends[2:], np.ones(1))

integrator = cf.Integrator(cf.IntegratorConfig(frame="palm", voxel_size=0.005))
for cloud in (skin, wrench, camera, free):
    integrator.receive(cloud)
fusion = integrator.step(now=1.0)

print(cf.explain_fusion(fusion))
print("each voxel, and why it is a contact or not:")
for place, likelihood, verdict in zip(
    fusion.space.positions, fusion.space.likelihoods, fusion.space.verdicts, strict=True
):
    print(f"  {place.round(4)} likelihood {likelihood:.2f} {verdict}")

out.mkdir(parents=True, exist_ok=True)
cf.plot_fusion(fusion).savefig(out / "contacts.png", dpi=120)
print(f"picture: {out / 'contacts.png'}")
