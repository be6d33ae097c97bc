"""A simulated hand touches a box, and its readings become a contact.

Run it with `python examples/touch_box.py [FOLDER]`; it needs contactfusion-lab. In YAML:
`contactfusion run examples/scenes/touch_box.yaml`.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import contactfusion as cf
from contactfusion_lab import TouchConfig, TouchScene

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out/touch_box")

# The robot: a URDF, and the poses of its sensors. Yours is another ROBOT.yaml.
robot = cf.read_robot("contactfusion.robots:arm_hand.yaml")
box = {
    "shapes": [{"shape": "box", "size": [0.08, 0.14, 0.2]}],
    "pose": {"parent": "base", "xyz": [0.7, 0.0, 0.35]},
}

# The world: the palm goes forward until the hand is pushed. Its sensors err as real ones do.
scene = TouchScene(
    TouchConfig.model_validate(
        {
            "objects": {"box": box},
            "tool": "palm",
            "posture": {"arm_2": 0.6, "arm_4": 1.2, "finger_1_proximal_joint": 0.7},
        }
    ),
    cf.RobotModel(robot),
    seed=9,
)

# The pipeline: a generator for each sensor, and how their hypotheses are fused.
skin: dict[str, Any] = {"type": "tactile", "baseline": {"noise": 0.02}}
pipeline = cf.Pipeline(
    cf.PipelineConfig(
        robot=robot,
        generators={
            "tip_1": {**skin, "sensor": "tip_1", "patch": "tip_1"},
            "tip_2": {**skin, "sensor": "tip_2", "patch": "tip_2"},
            "tip_3": {**skin, "sensor": "tip_3", "patch": "tip_3"},
            "wrist": {"type": "force_torque", "sensor": "wrist", "wrist": "wrist", "load": "robot"},
            "believed": {"type": "simulator", "objects": {"box": box}},
        },
        integrator=cf.IntegratorConfig(frame="base"),
    )
)

# Any source of readings can replace the scene: a recording, or the driver of a robot.
*_, last = pipeline.run(scene.readings())
print(cf.explain_fusion(last.fusion))

truth = scene.truth.contacts
for position, link in zip(truth.places, truth.links, strict=True):
    print(f"truth: {link} touched at {position.round(3)} m")
    for contact in last.fusion.contacts:
        print(f"  a contact is {np.linalg.norm(contact.position - position) * 1000:.0f} mm away")

out.mkdir(parents=True, exist_ok=True)
cf.plot_fusion(last.fusion).savefig(out / "contacts.png", dpi=120)
print(f"picture: {out / 'contacts.png'}")
