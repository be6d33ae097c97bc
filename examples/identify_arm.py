"""What the joints of an arm report in free motion: friction, offsets, a tool, and noise.

Writes the log of an arm that moves without contact, and a configuration without any numbers; then
identifies what `joint_torque` needs. Run it with `python examples/identify_arm.py [FOLDER]`, then
`contactfusion identify FOLDER/arm.yaml FOLDER/free.yaml --out FOLDER/identified.yaml`.
"""

import sys
from pathlib import Path

import numpy as np

import contactfusion as cf

LOG = """\
type: log
file: free.npy
time: {column: 1}
readings:
  arm:                        # positions, velocities, efforts
    type: joint_state
    frame: base
    names: [arm_1, arm_2, arm_3, arm_4, arm_5, arm_6, arm_7]
    columns: 2..22
"""
ROBOT = """\
urdf: contactfusion.robots:arm_hand.urdf
spacing: 0.01
still: {finger_1_spread: 0, finger_1_proximal_joint: 0, finger_1_distal_joint: 0,
        finger_2_spread: 0, finger_2_proximal_joint: 0, finger_2_distal_joint: 0,
        finger_3_proximal_joint: 0, finger_3_distal_joint: 0}
"""
CONFIGURATION = """\
robot: robot.yaml
generators:
  arm:
    type: joint_torque
    sensor: arm
    effort: measured
    joints: [arm_1, arm_2, arm_3, arm_4, arm_5, arm_6, arm_7]
integrator: {frame: base}
cycle: {on: arm}
"""
TOOL = "payload: {frame: link_7, mass: 0.8, centre_of_mass: [0.02, 0.0, 0.1]}\n"
RATE, SECONDS = 200.0, 30.0

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out/identify")
out.mkdir(parents=True, exist_ok=True)
(out / "free.yaml").write_text(LOG)
(out / "robot.yaml").write_text(ROBOT)
(out / "truth.yaml").write_text(ROBOT + TOOL)  # which no one has measured yet
(out / "arm.yaml").write_text(CONFIGURATION)

# Two sines a joint; torques by inverse dynamics, with friction, offsets and noise.
rng = np.random.default_rng(0)
stamps = np.arange(0.0, SECONDS, 1.0 / RATE)
positions, speeds, accelerations = np.zeros((3, len(stamps), 15))
positions[:, :7] = [0.0, 0.6, 0.0, 1.2, 0.0, 0.8, 0.0]
for size in (0.5, 0.25):
    rates = 2.0 * np.pi * rng.uniform(0.08, 0.12, 7) / size
    angles = np.outer(stamps, rates) + rng.uniform(0.0, 6.0, 7)
    positions[:, :7] += size * np.sin(angles)
    speeds[:, :7] += size * rates * np.cos(angles)
    accelerations[:, :7] -= size * rates**2 * np.sin(angles)
pin, model = cf.RobotModel(cf.read_robot(out / "truth.yaml")).kinematics
data = model.createData()
moved = zip(positions, speeds, accelerations, strict=True)
torques = np.array([pin.rnea(model, data, *each) for each in moved])[:, :7]
coulomb, viscous, offset = np.linspace(1.2, 0.2, 7), np.linspace(1.0, 0.1, 7), 0.3
rubbed = coulomb * np.tanh(speeds[:, :7] / 0.01) + viscous * speeds[:, :7]
noise = rng.normal(0.0, np.linspace(0.6, 0.1, 7), torques.shape)
log = [stamps[:, None], positions[:, :7], speeds[:, :7], torques + rubbed + offset + noise]
np.save(out / "free.npy", np.hstack(log))

found = cf.identify_file(out / "arm.yaml", out / "free.yaml", out / "identified.yaml")
print(*found.report(), sep="\n")
print(f"the truth: Coulomb {coulomb.round(2)}, viscous {viscous.round(2)}, offset {offset} N·m")

# One line more in the configuration, and it finds contacts with what was identified.
(out / "arm.yaml").write_text(f"{CONFIGURATION}identified: identified.yaml\n")
print(*cf.check_file(out / "arm.yaml", out / "free.yaml").lines, sep="\n")
