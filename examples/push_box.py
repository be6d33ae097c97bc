"""Push a box to a target behind the robot, by the robot's skin alone.

Run it with `python examples/push_box.py [FOLDER]`; it needs contactfusion-lab. In YAML:
`contactfusion run examples/scenes/push_box.yaml`.
"""

import sys
from itertools import groupby
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import contactfusion as cf
from contactfusion_lab import PushConfig, PushScene, pushed

TARGET = (-1.0, 1.0)

# The robot: an omnidirectional base with a skin. Yours is another URDF with one box that pushes.
robot = cf.read_robot("contactfusion.robots:mobile_base.yaml")

# The world: a box of 20 kg that is unknown to the robot.
scene = PushScene(PushConfig(target=TARGET, yaw=20.0), robot, seed=1)

# Tactile images become contacts in the robot's frame, and contacts become motion.
pipeline = cf.Pipeline(
    cf.PipelineConfig(
        robot=robot,
        generators={
            "skin": {
                "type": "tactile",
                "sensor": "skin",
                "patch": "skin",
                "baseline": {"noise": 0.05},
            }
        },
        integrator=cf.IntegratorConfig(frame="base", voxel_size=0.0125, timeout=0.25),
        controller={"type": "reactive_pushing", "target": TARGET},
    )
)

cycles = list(pushed(scene, pipeline))
last = cycles[-1]

# Each command carries the mode of the controller, and its reason.
commands = [(cycle.truth.stamp, cycle.step.command) for cycle in cycles]
for mode, some in groupby(commands, lambda pair: pair[1].mode if pair[1] else ""):
    stamp, command = next(some)
    print(f"{stamp:5.1f} s  {mode}: {command.reason if command else ''}")
print(f"{last.ending} after {last.truth.stamp:.1f} s")
print(f"truth: the box touches {last.truth.distance * 100:.1f} cm from the target")

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/push_box")
folder.mkdir(parents=True, exist_ok=True)
figure = Figure(figsize=(6.0, 6.0), layout="constrained")
axes = figure.subplots()
base = np.array([cycle.truth.base for cycle in cycles])
box = np.array([cycle.truth.object for cycle in cycles])
axes.plot(*base[:, :2].T, color="#0072b2", label="robot")
axes.plot(*box[:, :2].T, color="#d55e00", label="box")
axes.quiver(*base[::10, :2].T, np.cos(base[::10, 2]), np.sin(base[::10, 2]), color="#0072b2",
            width=0.004)  # fmt: skip
axes.plot(*TARGET, "x", color="#009e73", markersize=12, label="target of the contact")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="where robot and box went")
axes.legend()
figure.savefig(folder / "push_box.png", dpi=120)
print(f"picture: {folder / 'push_box.png'}")
