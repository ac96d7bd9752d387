#!/usr/bin/env python3
"""Six ranges with a bias each, through FilterPy's extended Kalman filter -> range_gain_filterpy.json (beside this file).

Versions: Python 3.11, filterpy 2.0.0, numpy 1.26.4.   Run: python3 range_gain_filterpy.py   Seed 20261122.

State [p (3, m), v (3, m/s), b (6, m)]; white-noise acceleration q = walk^2 per axis,
Q = q [dt^3/3, dt^2/2; dt^2/2, dt]; biases walk; z_i = |p - a_i| + b_i + noise. Readings are rounded to 1e-9 m before
they are filtered, so that the text holds exactly what was filtered.
"""

import json
from pathlib import Path

import filterpy
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

SEED, STEPS, DT = 20261122, 1000, 0.1
WALK, BIAS_WALK, SIGMA = 3e-4, 2e-4, 0.002
PRIOR = {"position_m": 0.05, "velocity_m_s": 0.002, "bias_m": 0.01}
ANCHORS = np.array(
    [[0.5, 0.0, 0.1], [-0.5, 0.1, 0.0], [0.0, 0.45, -0.1], [0.1, -0.5, 0.05], [0.05, 0.1, 0.55], [-0.1, 0.0, -0.5]]
)


def transition():
    f = np.eye(12)
    f[:3, 3:6] = DT * np.eye(3)
    q = np.zeros((12, 12))
    q[:3, :3] = np.eye(3) * WALK**2 * DT**3 / 3
    q[:3, 3:6] = q[3:6, :3] = np.eye(3) * WALK**2 * DT**2 / 2
    q[3:6, 3:6] = np.eye(3) * WALK**2 * DT
    q[6:, 6:] = np.eye(6) * BIAS_WALK**2 * DT
    return f, q


def ranges(x):
    return np.linalg.norm(x[:3] - ANCHORS, axis=1) + x[6:]


def jacobian(x):
    difference = x[:3] - ANCHORS
    h = np.zeros((6, 12))
    h[:, :3] = difference / np.linalg.norm(difference, axis=1)[:, None]
    h[:, 6:] = np.eye(6)
    return h


def main():
    rng = np.random.default_rng(SEED)
    f, q = transition()
    prior = np.repeat(list(PRIOR.values()), [3, 3, 6])
    truth = prior * rng.standard_normal(12)
    root = np.linalg.cholesky(q)
    ekf = ExtendedKalmanFilter(dim_x=12, dim_z=6)
    ekf.x, ekf.P, ekf.F, ekf.Q, ekf.R = np.zeros(12), np.diag(prior**2), f, q, np.eye(6) * SIGMA**2
    readings, nis, states, variances, square, log_likelihood = [], [], [], [], 0.0, 0.0
    for k in range(1, STEPS + 1):
        truth = f @ truth + root @ rng.standard_normal(12)
        z = np.round(ranges(truth) + SIGMA * rng.standard_normal(6), 9)
        ekf.predict()
        ekf.update(z, jacobian, ranges)
        readings.append(z.tolist())
        nis.append(float(ekf.y @ np.linalg.solve(ekf.S, ekf.y)))
        log_likelihood += float(ekf.log_likelihood)
        square += float(np.sum((ekf.x[:3] - truth[:3]) ** 2))
        if k % 10 == 0:
            states.append(ekf.x.tolist())
            variances.append(np.diag(ekf.P).tolist())
    document = {
        "program": f"filterpy {filterpy.__version__} ExtendedKalmanFilter, numpy {np.__version__}",
        "script": "tests/cross/range_gain_filterpy.py",
        "seed": SEED,
        "step_s": DT,
        "velocity_random_walk_m_s_per_sqrt_s": WALK,
        "bias_random_walk_m_per_sqrt_s": BIAS_WALK,
        "range_sigma_m": SIGMA,
        "prior_sigma": PRIOR,
        "anchors_world_m": ANCHORS.tolist(),
        "position_rmse_m": (square / STEPS) ** 0.5,
        "log_likelihood": log_likelihood,
        "nis": nis,
        "every": 10,
        "states": states,
        "variances": variances,
        "ranges_m": readings,
    }
    text = json.dumps(document).replace("], [", "],\n[").replace('], "', '],\n"')
    Path(__file__).with_suffix(".json").write_text(text + "\n")
    print("RMSE", document["position_rmse_m"], "log-likelihood", log_likelihood, "mean NIS", np.mean(nis))


if __name__ == "__main__":
    main()
