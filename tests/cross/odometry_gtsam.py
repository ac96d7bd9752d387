#!/usr/bin/env python3
"""Relative poses between key frames and position fixes, through GTSAM's iSAM2 -> odometry_gtsam.json (beside this file).

Versions: Python 3.11, gtsam 4.2.2, numpy 1.26.4, scipy 1.17.1.   Run: python3 odometry_gtsam.py   Seed 20261122.

600 poses a second apart. Odometry T_k-1^-1 T_k with 0.01 rad and 0.5 mm per axis; a position fix of 2 mm on every fifth
pose. Measurements are rounded to 1e-9 before they are used. iSAM2 gets each pose's factors and is asked for that pose at
once: what an on-line filter knows. Values: rotation vectors (rad), positions (m).
"""

import json
from pathlib import Path

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

SEED, POSES, EVERY = 20261122, 600, 5
ODOMETRY_RAD, ODOMETRY_M, FIX_M = 0.01, 0.5e-3, 2e-3
PRIOR_RAD, PRIOR_M = 0.02, 2e-3


def pose(rotation, position):
    return gtsam.Pose3(gtsam.Rot3(rotation.as_matrix()), np.asarray(position))


def simulate(rng):
    """Truth that turns and creeps smoothly; rounded measurements."""
    rotations, positions = [Rotation.from_rotvec([0.3, -0.2, 0.5])], [np.zeros(3)]
    rate, odometry, fixes = np.zeros(3), [], []
    for k in range(1, POSES):
        rate = 0.9 * rate + 0.02 * rng.standard_normal(3)
        step = np.array([3e-3, 0.0, 0.0]) + 3e-4 * rng.standard_normal(3)
        positions.append(positions[-1] + rotations[-1].apply(step))
        rotations.append(rotations[-1] * Rotation.from_rotvec(rate))
        measured = Rotation.from_rotvec(rate) * Rotation.from_rotvec(ODOMETRY_RAD * rng.standard_normal(3))
        moved = step + ODOMETRY_M * rng.standard_normal(3)
        odometry.append(np.round(np.concatenate([measured.as_rotvec(), moved]), 9).tolist())
        if k % EVERY == 0:
            fixes.append(np.round(positions[-1] + FIX_M * rng.standard_normal(3), 9).tolist())
    return rotations, positions, odometry, fixes


def main():
    rng = np.random.default_rng(SEED)
    rotations, positions, odometry, fixes = simulate(rng)
    first_position = np.round(positions[0] + PRIOR_M * rng.standard_normal(3), 9)
    first_rotation = np.round((rotations[0] * Rotation.from_rotvec(PRIOR_RAD * rng.standard_normal(3))).as_rotvec(), 9)
    prior_noise = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([PRIOR_RAD, PRIOR_M], 3))
    step_noise = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([ODOMETRY_RAD, ODOMETRY_M], 3))
    fix_noise = gtsam.noiseModel.Isotropic.Sigma(3, FIX_M)
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(1e-3)
    parameters.relinearizeSkip = 1
    isam = gtsam.ISAM2(parameters)
    estimates, last = [], None
    for k in range(POSES):
        graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
        if k == 0:
            last = pose(Rotation.from_rotvec(first_rotation), first_position)
            graph.add(gtsam.PriorFactorPose3(0, last, prior_noise))
        else:
            z = odometry[k - 1]
            relative = pose(Rotation.from_rotvec(z[:3]), z[3:])
            graph.add(gtsam.BetweenFactorPose3(k - 1, k, relative, step_noise))
            last = last.compose(relative)
            if k % EVERY == 0:
                graph.add(gtsam.GPSFactor(k, np.array(fixes[k // EVERY - 1]), fix_noise))
        start.insert(k, last)
        isam.update(graph, start)
        isam.update()
        last = isam.calculateEstimatePose3(k)
        estimates.append(last)
    at = np.array([e.translation() for e in estimates])
    errors = at - np.array(positions)
    turns = [(Rotation.from_matrix(e.rotation().matrix()).inv() * r).magnitude() for e, r in zip(estimates, rotations)]
    # GTSAM's tangent is [rotation, translation] in the body; the position's covariance is wanted in the world.
    marginal = isam.marginalCovariance(POSES - 1)
    turn = estimates[-1].rotation().matrix()
    position_rmse = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
    attitude_rmse = float(np.sqrt(np.mean(np.square(turns))))
    document = {
        "program": f"gtsam 4.2.2 ISAM2, numpy {np.__version__}",
        "script": "tests/cross/odometry_gtsam.py",
        "seed": SEED,
        "every": EVERY,
        "odometry_sigma_rad": ODOMETRY_RAD,
        "odometry_sigma_m": ODOMETRY_M,
        "fix_sigma_m": FIX_M,
        "prior_sigma_rad": PRIOR_RAD,
        "prior_sigma_m": PRIOR_M,
        "position_rmse_m": position_rmse,
        "attitude_rmse_rad": attitude_rmse,
        "last_position_covariance_world_m2": (turn @ marginal[3:, 3:] @ turn.T).tolist(),
        "last_attitude_covariance_capsule_rad2": marginal[:3, :3].tolist(),
        "first_rotation_vector_rad": first_rotation.tolist(),
        "first_position_m": first_position.tolist(),
        "odometry_rad_m": odometry,
        "fixes_m": fixes,
        "truth_positions_m": np.round(positions, 12).tolist(),
        "truth_rotation_vectors_rad": np.round([r.as_rotvec() for r in rotations], 12).tolist(),
        "isam2_positions_m": np.round(at, 9).tolist(),
    }
    text = json.dumps(document).replace("], [", "],\n[").replace('], "', '],\n"')
    Path(__file__).with_suffix(".json").write_text(text + "\n")
    print("iSAM2", position_rmse * 1e3, "mm", np.degrees(attitude_rmse), "deg")


if __name__ == "__main__":
    main()
