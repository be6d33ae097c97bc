"""Grasp a bottle that is not quite in front of the hand, by a wrist sensor and motion.

Run it with `python examples/grasp_bottle.py [FOLDER]`; it needs contactfusion-lab. In YAML:
`contactfusion run examples/scenes/grasp_bottle.yaml`.
"""

import sys
from itertools import groupby
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import contactfusion as cf
from contactfusion_lab import GraspConfig, GraspScene, grasped, result_of

# The robot: an arm with three fingers and a wrist that measures force and torque.
robot = cf.read_robot("contactfusion.robots:arm_hand.yaml")
fingers = [f"finger_{number}" for number in (1, 2, 3)]
gripper = {f"{finger}_proximal_joint": (-0.15, 1.3) for finger in fingers}
gripper |= {f"{finger}_distal_joint": (0.0, 0.6) for finger in fingers}

# The world: a bottle on a table, 4.5 cm to the left of the hand's path.
scene = GraspScene(
    GraspConfig.model_validate(
        {
            "object": {
                "urdf": "contactfusion_lab.experiments.grasp:bottle.urdf",
                "pose": {"parent": "base", "xyz": [0.8, 0.0, 0.25]},
            },
            "surroundings": {
                "table": {
                    "shapes": [{"shape": "box", "size": [0.5, 0.9, 0.04]}],
                    "pose": {"parent": "base", "xyz": [0.8, 0.0, 0.23]},
                }
            },
            "tool": "palm",
            "gripper": gripper,
            "posture": {"arm_2": -0.4, "arm_4": -2.0},
            "offset": 0.045,
            "distance": 0.28,
        }
    ),
    cf.RobotModel(robot),
    seed=1,
)

# A wrench is evidence, motion supports it where the hand is about to be: contacts drive the hand.
hand = ["palm", *(f"{finger}_{part}" for finger in fingers for part in ("proximal", "distal"))]
fresh = {"timeout": 0.1, "replace": True}
wrist = {"type": "force_torque", "sensor": "wrist", "wrist": "wrist", "load": "robot"}
motion = {"type": "motion", "sensor": "joints", "links": hand}
pipeline = cf.Pipeline(
    cf.PipelineConfig(
        robot=robot,
        generators={"wrist": {**wrist, "average": 0.1, **fresh}, "motion": {**motion, **fresh}},
        integrator=cf.IntegratorConfig(frame="base"),
        controller={"type": "reactive_grasp", "tool": "palm", "gripper": gripper},
    )
)

cycles = list(grasped(scene, pipeline))
commands = [(cycle.truth.stamp, cycle.step.command) for cycle in cycles]
for mode, some in groupby(commands, lambda pair: pair[1].mode if pair[1] else ""):
    stamp, command = next(some)
    print(f"{stamp:5.1f} s  {mode}: {command.reason if command else ''}")
result = result_of(cycles, scene.config.lifted, scene.config.held)
print(f"truth: the bottle is {result.height * 100:.1f} cm higher, {result.corrections} corrections")

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/grasp_bottle")
folder.mkdir(parents=True, exist_ok=True)
figure = Figure(figsize=(6.0, 4.0), layout="constrained")
axes = figure.subplots()
palm, bottle = (
    100.0 * np.array([getattr(cycle.truth, name)[:3, 3] for cycle in cycles])
    for name in ("tool", "object")
)
axes.plot(palm[:, 0], palm[:, 1], color="#0072b2", label="palm")
axes.plot(bottle[:, 0], bottle[:, 1], color="#d55e00", label="bottle")
axes.set(xlabel="x [cm]", ylabel="y [cm]", aspect="equal", title="hand and bottle from above")
axes.legend()
figure.savefig(folder / "grasp_bottle.png", dpi=120)
print(f"picture: {folder / 'grasp_bottle.png'}")
