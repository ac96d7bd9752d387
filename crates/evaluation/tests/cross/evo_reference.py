"""Trajectory errors by evo, the reference for `crates/evaluation/tests/evo.rs`.

Program: evo 1.38.1 (GPL-3: run here, not copied), numpy 2.4.6, Python 3.11 or later.
    python -m venv venv && venv/bin/pip install evo==1.38.1 numpy==2.4.6
    venv/bin/python evo_reference.py
Writes, beside itself: evo_reference.tum, evo_estimate.tum and evo_reference.json. Seed 20240611.

The trajectories are of the size of a capsule examination: a winding path inside 0.3 m with a rest, at 10 Hz
for three minutes. The estimate is scaled by 3 %, rotated and shifted a little, noisy by 1 mm and 2 degrees;
its stamps jitter by up to 3 ms, some are missing and some lie 12 to 30 ms off so that they must not be matched.
"""

import copy
import json
from pathlib import Path

import numpy as np
from evo import __version__ as evo_version
from evo.core import metrics, sync
from evo.core.units import Unit
from evo.tools import file_interface

HERE = Path(__file__).resolve().parent
SEED = 20240611
RELATIONS = ["translation_part", "rotation_part", "rotation_angle_rad", "rotation_angle_deg", "full_transformation"]
DELTAS = [
    ("frames", 1),
    ("frames", 7),
    ("meters", 0.02),
    ("meters", 0.05),
    ("radians", 0.5),
    ("degrees", 20.0),
]
# Direct angles between all pairs cost the square of the length, so that rule is compared on this many poses.
POSES_FOR_ALL_ANGLE_PAIRS = 250


def quaternion_from_rotation_vectors(vectors):
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    half = 0.5 * angle
    factor = np.where(angle > 1e-12, np.sin(half) / np.maximum(angle, 1e-12), 0.5)
    return np.hstack([vectors * factor, np.cos(half)])  # x y z w


def quaternion_product(a, b):
    av, aw, bv, bw = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.hstack([vector, aw * bw - np.sum(av * bv, axis=1, keepdims=True)])


def rotate(quaternion, points):
    v, w = quaternion[:, :3], quaternion[:, 3:]
    t = 2.0 * np.cross(v, points)
    return points + w * t + np.cross(v, t)


def truth(t):
    # Progress with a rest between 70 s and 85 s, where the path length stands still.
    progress = np.interp(t, [0.0, 70.0, 85.0, 180.0], [0.0, 70.0, 70.0, 165.0])
    position = np.stack(
        [
            0.10 * np.cos(0.045 * progress) + 0.015 * np.cos(0.31 * progress),
            0.08 * np.sin(0.060 * progress + 0.4) + 0.012 * np.sin(0.27 * progress),
            0.05 * np.sin(0.035 * progress) + 0.010 * np.cos(0.41 * progress),
        ],
        axis=1,
    )
    rotation_vector = np.stack(
        [1.1 * np.sin(0.09 * progress), 0.9 * np.cos(0.07 * progress), 1.6 * np.sin(0.05 * progress + 1.0)], axis=1
    )
    return position, quaternion_from_rotation_vectors(rotation_vector)


def write_tum(path, role, stamps, position, quaternion):
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"# {role}, made by evo_reference.py (numpy {np.__version__}, seed {SEED})\n")
        file.write("# timestamp_s x_m y_m z_m qx qy qz qw (world_from_capsule)\n")
        for t, p, q in zip(stamps, position, quaternion):
            file.write(" ".join([f"{t:.4f}"] + [f"{v:.6f}" for v in (*p, *q)]) + "\n")


def make_trajectories():
    rng = np.random.default_rng(SEED)
    stamps = np.arange(1800) * 0.1
    position, quaternion = truth(stamps)
    write_tum(HERE / "evo_reference.tum", "truth", stamps, position, quaternion)

    kept = np.sort(rng.choice(1800, size=1700, replace=False))
    shift = rng.uniform(-0.003, 0.003, size=kept.size)
    late = rng.choice(kept.size, size=25, replace=False)
    shift[late] = rng.uniform(0.012, 0.030, size=late.size)
    estimate_stamps = np.round(stamps[kept] + shift + 0.004, 4)
    position, quaternion = truth(estimate_stamps)
    tilt = quaternion_from_rotation_vectors(np.array([[0.05, -0.08, 0.12]]))
    position = 1.03 * rotate(np.repeat(tilt, kept.size, axis=0), position) + np.array([0.004, -0.007, 0.011])
    position += rng.normal(scale=0.001, size=position.shape)
    noise = quaternion_from_rotation_vectors(rng.normal(scale=np.radians(2.0), size=position.shape))
    quaternion = quaternion_product(quaternion_product(np.repeat(tilt, kept.size, axis=0), quaternion), noise)
    write_tum(HERE / "evo_estimate.tum", "estimate", estimate_stamps, position, quaternion)


def load(name):
    return file_interface.read_tum_trajectory_file(str(HERE / name))


def associated(reference, estimate, alignment):
    reference, estimate = sync.associate_trajectories(reference, estimate, max_diff=0.01)
    parameters = None
    if alignment != "none":
        rotation, translation, scale = estimate.align(reference, correct_scale=alignment == "align+scale")
        parameters = {"rotation": rotation.tolist(), "translation_m": translation.tolist(), "scale": float(scale)}
    return reference, estimate, parameters


def figures(metric):
    return {"count": int(len(metric.error)), "statistics": {k: float(v) for k, v in metric.get_all_statistics().items()}}


def absolute(cases, name, reference, estimate):
    for alignment in ["none", "align", "align+scale"]:
        ref, est, parameters = associated(reference, estimate, alignment)
        for relation in RELATIONS:
            metric = metrics.APE(metrics.PoseRelation[relation])
            metric.process_data((ref, est))
            cases.append(
                {"metric": "ape", "roles": name, "alignment": alignment, "relation": relation, "parameters": parameters}
                | figures(metric)
            )


def relative(cases, reference, estimate, alignment, deltas, relations):
    ref, est, _ = associated(reference, estimate, alignment)
    for unit, delta in deltas:
        for all_pairs in [False, True]:
            poses = ref.num_poses
            if all_pairs and unit in ("radians", "degrees"):
                poses = POSES_FOR_ALL_ANGLE_PAIRS
            for from_reference in [False, True]:
                for relation in relations:
                    metric = metrics.RPE(
                        metrics.PoseRelation[relation],
                        delta=delta,
                        delta_unit=Unit[unit],
                        rel_delta_tol=0.1,
                        all_pairs=all_pairs,
                        pairs_from_reference=from_reference,
                    )
                    short_ref, short_est = (copy.deepcopy(x) for x in (ref, est))
                    short_ref.reduce_to_ids(range(poses))
                    short_est.reduce_to_ids(range(poses))
                    metric.process_data((short_ref, short_est))
                    cases.append(
                        {
                            "metric": "rpe",
                            "alignment": alignment,
                            "relation": relation,
                            "delta": delta,
                            "unit": unit,
                            "all_pairs": all_pairs,
                            "pairs_from_reference": from_reference,
                            "poses": poses,
                        }
                        | figures(metric)
                    )


def main():
    make_trajectories()
    reference, estimate = load("evo_reference.tum"), load("evo_estimate.tum")
    cases = []
    absolute(cases, "reference first", reference, estimate)
    absolute(cases, "swapped", estimate, reference)
    relative(cases, reference, estimate, "none", DELTAS, RELATIONS)
    relative(cases, reference, estimate, "align+scale", [("meters", 0.05)], ["translation_part"])
    result = {
        "program": f"evo {evo_version}",
        "script": "evo_reference.py",
        "seed": SEED,
        "t_max_diff_s": 0.01,
        "matched": int(sync.associate_trajectories(reference, estimate, max_diff=0.01)[0].num_poses),
        "cases": cases,
    }
    (HERE / "evo_reference.json").write_text(json.dumps(result, indent=1) + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
