#!/usr/bin/env python3
"""The solves of `cargo bench -p lumenav-magnetic` with magpylib's field and SciPy's least squares (one core).

Versions: Python 3.11, magpylib 5.2.3, SciPy 1.17.1, NumPy 2.4.
Run: OMP_NUM_THREADS=1 python3 magnetic_bench.py [microseconds per warm dipole solve of ours]
Prints the best of 3 runs and, with an argument, the ratio; no file is written (timings belong to a machine, not to a
repository). Same 64 poses, same noise, same starts; residuals scaled to unit noise; the axis by two tangent coordinates at
the start, derivatives by differences, as a user of these two libraries would write it.
"""

import sys
import time

import magpylib
import numpy as np
from scipy.optimize import least_squares

SIGMA = 1.2e-8
STEPS = [0.618033988749895, 0.754877666246693, 0.819172513396164, 0.8566748838545029, 0.8812714616335696,
         0.8986537126286993, 0.9115923534820551]
GRID = np.linspace(-0.25, 0.25, 4)
SENSORS = np.array([[x, y, 0.0] for y in GRID for x in GRID])
MU0 = 4e-7 * np.pi
MOMENT = 1.212891e-8 / 1e-7


def spread(index, dimension):
    return (0.5 + STEPS[dimension] * (index + 1)) % 1.0


def direction(height, turn):
    z = 2.0 * height - 1.0
    rho = np.sqrt(1.0 - z * z)
    return np.array([rho * np.cos(2 * np.pi * turn), rho * np.sin(2 * np.pi * turn), z])


def flux(position, axis):
    moments = np.tile(MOMENT * axis, (len(SENSORS), 1))
    return MU0 * magpylib.core.dipole_Hfield(observers=SENSORS - position, moments=moments).ravel()


def tangent(axis):
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def cases():
    for i in range(64):
        u = [spread(i, d) for d in range(7)]
        position = np.array([0.4 * u[0] - 0.2, 0.4 * u[1] - 0.2, 0.1 + 0.2 * u[2]])
        axis, away = direction(u[3], u[4]), direction(u[5], u[6])
        noise = np.array([SIGMA * np.sqrt(12.0) * (spread(i * 48 + k, 0) - 0.5) for k in range(48)])
        start = axis + away * np.radians(2.0)
        yield position, position + away * 3e-3, start / np.linalg.norm(start), flux(position, axis) + noise


def solve(start_position, start_axis, reading):
    e1, e2 = tangent(start_axis)

    def residual(x):
        axis = start_axis + x[3] * e1 + x[4] * e2
        return (reading - flux(x[:3], axis / np.linalg.norm(axis))) / SIGMA

    return least_squares(residual, np.concatenate([start_position, [0.0, 0.0]]), method="lm", x_scale="jac")


def main():
    prepared = list(cases())
    best = np.inf
    for _ in range(3):
        begin = time.perf_counter()
        worst = 0.0
        for truth, position, axis, reading in prepared:
            worst = max(worst, np.linalg.norm(solve(position, axis, reading).x[:3] - truth))
        best = min(best, (time.perf_counter() - begin) / len(prepared))
    assert worst < 0.04, worst
    print(f"magpylib + SciPy, warm dipole: {best * 1e6:.0f} us per solve, worst error {worst * 1e3:.2f} mm")
    if len(sys.argv) > 1:
        print(f"ratio: {best * 1e6 / float(sys.argv[1]):.0f}")


if __name__ == "__main__":
    main()
