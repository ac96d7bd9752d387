#!/usr/bin/env python3
"""Time of one predict and update of FilterPy's extended Kalman filter: 12 states, six ranges (for `crates/fusion/benches`).

Versions: Python 3.11, filterpy 2.0.0, numpy 1.26.4.   Run: python3 filter_bench.py

CPU time, best of 6 runs of 1000 steps: the wall time of a shared machine says little.
"""

import time

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

import range_gain_filterpy as problem

STEPS, REPEATS = 1000, 6


def run(readings):
    f, q = problem.transition()
    ekf = ExtendedKalmanFilter(dim_x=12, dim_z=6)
    prior = np.repeat(list(problem.PRIOR.values()), [3, 3, 6])
    ekf.x, ekf.P, ekf.F, ekf.Q, ekf.R = np.zeros(12), np.diag(prior**2), f, q, np.eye(6) * problem.SIGMA**2
    start = time.process_time()
    for z in readings:
        ekf.predict()
        ekf.update(z, problem.jacobian, problem.ranges)
    return (time.process_time() - start) / len(readings)


def main():
    rng = np.random.default_rng(problem.SEED)
    readings = problem.ranges(np.zeros(12)) + problem.SIGMA * rng.standard_normal((STEPS, 6))
    best = min(run(readings) for _ in range(REPEATS))
    print(f"FilterPy EKF, 12 states, 6 ranges: {best * 1e6:.1f} us CPU per predict and update")


if __name__ == "__main__":
    main()
