"""Plots the position error of every track of a run: python docs/read-results.py RUN_FOLDER [OUT.png]. Needs pyarrow, matplotlib."""
import sys
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pyarrow.parquet as pq

folder = sys.argv[1]
target = sys.argv[2] if len(sys.argv) > 2 else "errors.png"
table = pq.read_table(f"{folder}/tracks.parquet").to_pandas()
figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
for name, track in table.groupby("track"):
    axes.plot(track["t_ns"] * 1e-9, track["error_mm"], lw=0.8, label=f"{name} (mean {track['error_mm'].mean():.2f} mm)")
axes.set(xlabel="time / s", ylabel="position error / mm", title=folder)
axes.set_ylim(bottom=0)
axes.legend()
figure.savefig(target, dpi=150)
print(target)
