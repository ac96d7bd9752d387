"""Plots the position error of every track of a run: python docs/read-results.py RUN_FOLDER [OUT.png]. Needs pyarrow, matplotlib."""
import sys
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pyarrow.compute as pc
import pyarrow.parquet as pq

folder = sys.argv[1]
target = sys.argv[2] if len(sys.argv) > 2 else "errors.png"
table = pq.read_table(f"{folder}/tracks.parquet", columns=["track", "t_ns", "error_mm"])
figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
for name in sorted(table["track"].unique().to_pylist()):
    track = table.filter(pc.equal(table["track"], name))
    mean = pc.mean(track["error_mm"]).as_py()
    if mean is None:  # A replay without truth has no errors.
        print(f"{name}: no truth, no errors")
        continue
    axes.plot(track["t_ns"].to_numpy() * 1e-9, track["error_mm"].to_numpy(), lw=0.8, label=f"{name} (mean {mean:.2f} mm)")
axes.set(xlabel="time / s", ylabel="position error / mm", title=folder)
axes.set_ylim(bottom=0)
if axes.lines:
    axes.legend()
figure.savefig(target, dpi=150)
print(target)
