#!/usr/bin/env python3
"""magpylib's evaluations per second on the points of `cargo bench -p lumenav-fields` (one core).

Versions: Python 3.11, magpylib 5.2.3, numpy 2.4.6.   Run: OMP_NUM_THREADS=1 python3 fields_bench.py
Prints the best of 20 runs; no file is written (timings belong to a machine, not to a repository).
"""

import time

import magpylib
import numpy as np

COUNT = 16_384


def points(nearest, farthest):
    index = np.arange(COUNT)
    z = 1.0 - (2.0 * index + 1.0) / COUNT
    turn = 2.399963229728653 * index
    rho = np.sqrt(1.0 - z * z)
    radius_m = 0.0508 * (nearest + (farthest - nearest) * (index * 6151 % COUNT) / COUNT)
    return np.stack([rho * np.cos(turn), rho * np.sin(turn), z], axis=1) * radius_m[:, None]


def best_rate(call, repeats=20):
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    return COUNT / best


def main():
    magnet = magpylib.magnet.Cylinder(polarization=(0, 0, 1.48), dimension=(0.1016, 0.1016))
    dipole = magpylib.misc.Dipole(moment=(0, 0, 970.114189))
    print(f"magpylib {magpylib.__version__}, numpy {np.__version__}, {COUNT} points")
    for nearest, farthest in ((2.0, 8.0), (1.05, 1.5), (12.0, 100.0)):
        where = points(nearest, farthest)
        rate = best_rate(lambda where=where: magnet.getB(where))
        print(f"Cylinder.getB, {nearest} to {farthest} radii: {rate / 1e6:.3f} M/s")
    where = points(2.0, 8.0)
    print(f"Dipole.getB: {best_rate(lambda: dipole.getB(where)) / 1e6:.3f} M/s")


if __name__ == "__main__":
    main()
