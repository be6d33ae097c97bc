"""From a log to contacts: a wrist sensor measures a touch on a cylindrical tool.

Writes the log that a robot would have written, describes it in YAML, and runs a pipeline on it.
Run it with `python examples/feed_a_log.py [FOLDER]`; then change the YAML and run
`contactfusion run FOLDER/wrist.yaml --set generators.wrist.min_force=4`.
"""

import csv
import sys
from pathlib import Path

import numpy as np

import contactfusion as cf

DESCRIPTION = """\
recording:
  type: log
  file: wrist.csv
  time: {column: t}
  readings:
    wrist: {type: wrench, frame: wrist, columns: [fx, fy, fz, tx, ty, tz]}

generators:
  wrist: {type: force_torque, sign: on_robot, tare: 0.5, force_noise: 0.1, torque_noise: 0.01}

surface:                      # what can be touched, in the frame it is fixed to
  frame: tool
  shapes: [{shape: cylinder, radius: 0.03, length: 0.2}]

frames:                       # poses of the sensor and the tool in their parents
  wrist: {parent: base, xyz: [0, 0, 1]}
  tool: {parent: wrist, xyz: [0, 0, 0.12]}

integrator: {frame: base, voxel_size: 0.005}
cycle: {on: wrist}
"""

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out/log")
out.mkdir(parents=True, exist_ok=True)

# Three seconds at 100 Hz; for the second one, 5 N press on the tool's side, 15 cm from the sensor.
rng = np.random.default_rng(0)
position, force = np.array([0.03, 0.0, 0.15]), np.array([-5.0, 0.0, 0.0])
bias = np.array([0.4, -0.2, 7.0, 0.01, 0.0, -0.02])
with (out / "wrist.csv").open("w", newline="") as file:
    writer = csv.writer(file)
    writer.writerow(["t", "fx", "fy", "fz", "tx", "ty", "tz"])
    for t in np.arange(0.0, 3.0, 0.01):
        touch = 1.0 if 1.0 <= t < 2.0 else 0.0
        wrench = touch * np.concatenate([force, np.cross(position, force)]) + bias
        wrench += rng.normal(0.0, [0.1] * 3 + [0.01] * 3)
        writer.writerow([f"{t:.2f}", *(f"{value:.5f}" for value in wrench)])
(out / "wrist.yaml").write_text(DESCRIPTION)

cf.run_file(out / "wrist.yaml", out=out)

with (out / "contacts.csv").open() as file:
    rows = list(csv.DictReader(file))
found = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
errors = np.linalg.norm(found - (position + [0.0, 0.0, 1.0]), axis=1)
print(f"{len(rows)} contacts while it was touched for 100 samples")
print(f"median distance from the true position: {np.median(errors) * 1000:.1f} mm")
