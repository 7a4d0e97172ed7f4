"""What outrigger writes, in numpy and matplotlib: a study's rows and a recording's points.

    outrigger study pareto --quick --seeds 1 --out pareto
    outrigger decode capture.pcap --meta sensor.json --out points.npy
    python docs/examples/plot_study.py pareto points.npy picture.png

Each `# %%` begins a cell of a notebook (VS Code, Spyder, Jupytext). Needs numpy and matplotlib.
"""

# %% what to plot
import csv
import json
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")  # into a file; leave that out in a notebook
import matplotlib.pyplot as plt
import numpy as np

study, points_npy, picture = map(pathlib.Path, sys.argv[1:4])

# %% the findings: what the study says, as tables of texts, and its rows: one search each
findings = json.loads((study / "findings.json").read_text())["findings"]
print(findings["summary"])
for claim in findings["claims"]:
    print(claim)
with open(study / "rows.csv", newline="") as file:
    rows = list(csv.DictReader(file))
print(f"{len(rows)} searches, tables: {[table['name'] for table in findings['tables']]}")

# %% the points of one recording: x forward, y left, z up, metres, in the frame that the file was asked for
cloud_points = np.load(points_npy)
points = np.stack([cloud_points[name] for name in ("x_m", "y_m", "z_m")], axis=1)
print(f"{len(points)} points, from {points.min(axis=0)} to {points.max(axis=0)} m")

# %% three pictures
figure, (front, search, cloud) = plt.subplots(1, 3, figsize=(16, 5), layout="constrained")

for preset, path in sorted({(row["preset"], row["path"]) for row in rows}):
    mine = [row for row in rows if (row["preset"], row["path"]) == (preset, path) and row["min_angle_deg"]]
    angles_deg = np.array([float(row["min_angle_deg"]) for row in mine])
    voxels = np.array([int(row["unique_voxels"]) for row in mine])
    front.scatter(angles_deg, voxels, s=18, label=f"{preset}, {path}")
front.set(xlabel="least angle between two sensors, degrees", ylabel="voxels seen", title="what an angle costs")
front.legend(fontsize="small")

for row in rows:
    history = np.array(json.loads(row["history"]))
    feasible = history[:, 1] > 0  # what breaks a constraint costs far more than all there is to see
    search.step(history[feasible, 0], history[feasible, 1], where="post", lw=1, alpha=0.6)
search.set(xlabel="evaluations", ylabel="best objective J", title="the searches")

some = points[:: max(1, len(points) // 50_000)]
near = np.linalg.norm(some[:, :2], axis=1) < np.quantile(np.linalg.norm(some[:, :2], axis=1), 0.98)
dots = cloud.scatter(some[near, 0], some[near, 1], c=some[near, 2], s=0.3, cmap="viridis", rasterized=True)
figure.colorbar(dots, ax=cloud, label="z, m")
cloud.set(xlabel="x, m", ylabel="y, m", title=points_npy.name, aspect="equal")

figure.savefig(picture, dpi=110)
print(picture)
