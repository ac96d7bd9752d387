#!/usr/bin/env python3
"""Time per window of pept's PEPT-ML (cutpoints, HDBSCAN) beside this project's trackers, on the same windows of three markers.

Versions: Python 3.11, pept 0.5.1, numpy 1.26.4, hdbscan 0.8.40, scikit-learn 1.3.2.
Run: cargo build --release && python3 tests/cross/pept_bench.py

The windows are two seconds of `scenarios/helix-pet.toml` (seed 1), written by `run --save-readings`. pept is made for tracers that are
well apart and knows no rigid body: it answers with the centres of clusters. It is given every chance: lines are cut to 20 mm about the
true centroid, and its two settings are those that a scan found best on such windows. pept is under the GPL: it is run, never linked.
"""

import csv
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import pept
from pept.tracking import Centroids, Cutpoints, HDBSCAN, SplitAll

ROOT = Path(__file__).resolve().parents[2]
MARKERS_MM = np.array([[-12.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, -5.0, 0.0]])
REGION_MM, CUT_MM, TRUE_FRACTION = 20.0, 0.3, 0.08
COLUMNS = ["t_ms", "x1_mm", "y1_mm", "z1_mm", "x2_mm", "y2_mm", "z2_mm"]


def run(folder):
    """Simulates, and says what each tracker took per window, ms."""
    command = [ROOT / "target/release/lumenav", "-q", "run", ROOT / "scenarios/helix-pet.toml"]
    command += ["--set", "scenario.duration_s=2", "--set", "record.truth_rate_hz=40"]
    command += ["--record", "none", "--save-readings", "--out", folder]
    subprocess.run(command, check=True)
    tracks = json.loads((folder / "timing.json").read_text())["tracks"]
    return {name: track["update_ms"]["median"] for name, track in tracks.items()}


def windows(folder):
    """Lines per window: t (ms), ends (mm)."""
    found = {}
    with open(folder / "readings" / "scanner.csv") as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            found.setdefault(float(row["end_s"]), []).append([float(row[name]) for name in COLUMNS])
    return {end: np.array(lines) for end, lines in found.items()}


def markers_mm(folder):
    """True markers by time."""
    rows = np.loadtxt(folder / "truth.tum", comments="#")
    out = {}
    for t, *p, x, y, z, w in rows:
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        out[round(t * 1e3)] = MARKERS_MM @ turn.T + 1e3 * np.array(p)
    return out


def near(lines, centre):
    """Lines that pass the centre within the region."""
    a, b = lines[:, 1:4], lines[:, 4:7]
    along = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    off = (centre - a) - np.sum((centre - a) * along, axis=1)[:, None] * along
    return lines[np.linalg.norm(off, axis=1) < REGION_MM]


def centres(lines):
    points = Cutpoints(CUT_MM).fit_sample(pept.LineData(lines))
    labelled = HDBSCAN(TRUE_FRACTION).fit_sample(points)
    clusters = (SplitAll("label") + Centroids()).fit(labelled, verbose=False)
    return np.array([c.points[0, 1:4] for c in clusters if len(c.points)])


def main():
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        ours = run(folder)
        data, truth = windows(folder), markers_mm(folder)
    seconds, count, right = [], [], 0
    for end, lines in data.items():
        markers = truth[min(truth, key=lambda t: abs(t - (end * 1e3 - 25.0)))]
        cut = near(lines, markers.mean(axis=0))
        start = time.perf_counter()
        found = centres(cut)
        seconds.append(time.perf_counter() - start)
        count.append(len(found))
        if len(found):
            gaps = np.linalg.norm(found[:, None] - markers[None], axis=2).min(axis=0)
            right += bool((gaps < 3.0).all())
    theirs = 1e3 * float(np.median(seconds))
    print(f"{len(data)} windows of {np.mean([len(w) for w in data.values()]):.0f} lines")
    print(
        f"pept {pept.__version__}: median {theirs:.2f} ms per window, {np.mean(count):.1f} clusters of 3, "
        f"every marker within 3 mm of one in {right} of {len(data)} windows"
    )
    for name, ms in ours.items():
        print(f"lumenav {name}: median {ms:.3f} ms per window; pept takes {theirs / ms:.0f} times as long")


if __name__ == "__main__":
    main()
