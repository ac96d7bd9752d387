#!/usr/bin/env python3
"""Unlabelled lines of three markers: log-likelihood, gradient and observed information -> lines_mixture.json (beside this
file), by automatic differentiation that shares nothing with the closed forms of the plugin.

Versions: Python 3.11, numpy 1.26.4, mpmath 1.3.0.   Run: python3 lines_mixture.py   Seed 20261122.

Line l: a point a_l and a unit direction u_l. Marker i at m_i = p + R c_i. With d the distance of m_i from the line,
p(l) = w_0 / (pi B^2) + sum_i w_i exp(-d^2 / 2 s^2) / (2 pi s^2), background uniform over a disc of radius B across u.
The log-likelihood is expanded to second order in the pose's error e = [dp_world, dtheta_capsule], p + dp and
R Exp(dtheta), in 40 digits with central differences of step 1e-10 (truncation below 1e-15 relative).
"""

import json
from pathlib import Path

import mpmath
import numpy as np
from mpmath import mp, mpf

mp.dps = 40
SEED, LINES = 20261122, 500
SIGMA, BACKGROUND, DISC = 3e-3, 0.3, 0.1
MARKERS = [[-12e-3, 0.0, 0.0], [0.0, 5e-3, 0.0], [0.0, -5e-3, 0.0]]
STEP = mpf("1e-10")


def exp_so3(v):
    """Rodrigues in mpmath, as a list of rows; Taylor to second order is exact enough for steps of 1e-10."""
    angle = mpmath.sqrt(sum(x * x for x in v))
    if angle == 0:
        return [[mpf(int(i == j)) for j in range(3)] for i in range(3)]
    k = [[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]]
    a, b = mpmath.sin(angle) / angle, (1 - mpmath.cos(angle)) / angle**2
    square = [[sum(k[i][m] * k[m][j] for m in range(3)) for j in range(3)] for i in range(3)]
    return [[mpf(int(i == j)) + a * k[i][j] + b * square[i][j] for j in range(3)] for i in range(3)]


def product(a, b):
    return [[sum(a[i][m] * b[m][j] for m in range(3)) for j in range(3)] for i in range(3)]


def log_likelihood(lines, position, rotation, error):
    p = [position[i] + error[i] for i in range(3)]
    r = product(rotation, exp_so3(error[3:]))
    markers = [[p[i] + sum(r[i][j] * c[j] for j in range(3)) for i in range(3)] for c in MARKERS_MP]
    weight = (1 - mpf(BACKGROUND)) / 3 / (2 * mp.pi * mpf(SIGMA) ** 2)
    total = mpf(0)
    for a, u in lines:
        density = mpf(BACKGROUND) / (mp.pi * mpf(DISC) ** 2)
        for m in markers:
            d = [m[i] - a[i] for i in range(3)]
            along = sum(d[i] * u[i] for i in range(3))
            # The direction's own length is kept: it is 1 only to the digits that are written down.
            across = [d[i] - along * u[i] for i in range(3)]
            density += weight * mpmath.exp(-sum(x * x for x in across) / (2 * mpf(SIGMA) ** 2))
        total += mpmath.log(density)
    return total


def derivatives(lines, position, rotation):
    def f(pairs):
        error = [mpf(0)] * 6
        for index, sign in pairs:
            error[index] += sign * STEP
        return log_likelihood(lines, position, rotation, error)

    centre = f([])
    ahead, behind = [f([(i, 1)]) for i in range(6)], [f([(i, -1)]) for i in range(6)]
    gradient = [(ahead[i] - behind[i]) / (2 * STEP) for i in range(6)]
    hessian = [[mpf(0)] * 6 for _ in range(6)]
    for i in range(6):
        hessian[i][i] = (ahead[i] - 2 * centre + behind[i]) / STEP**2
        for j in range(i):
            mixed = f([(i, 1), (j, 1)]) - f([(i, 1), (j, -1)]) - f([(i, -1), (j, 1)]) + f([(i, -1), (j, -1)])
            hessian[i][j] = hessian[j][i] = mixed / (4 * STEP**2)
    return centre, gradient, hessian


def draw_lines(rng, position, rotation):
    lines = []
    for _ in range(LINES):
        u = rng.standard_normal(3)
        u /= np.linalg.norm(u)
        e1 = np.linalg.svd(u[None, :])[2][1]
        e2 = np.cross(u, e1)
        if rng.random() < BACKGROUND:
            radius, angle = DISC * np.sqrt(rng.random()), 2 * np.pi * rng.random()
            a = radius * (np.cos(angle) * e1 + np.sin(angle) * e2)
        else:
            marker = position + rotation @ np.array(MARKERS[rng.integers(3)])
            a = marker + SIGMA * (rng.standard_normal() * e1 + rng.standard_normal() * e2)
        a = a + u * rng.uniform(-0.3, 0.3)
        lines.append((np.round(a, 12), u))
    return lines


MARKERS_MP = [[mpf(x) for x in c] for c in MARKERS]


def main():
    rng = np.random.default_rng(SEED)
    position = np.array([0.012, -0.007, 0.02])
    turn = [mpf(x) for x in ("0.4", "-0.8", "0.3")]
    rotation = exp_so3(turn)
    lines = draw_lines(rng, position, np.array([[float(x) for x in row] for row in rotation]))
    exact = [([mpf(float(x)) for x in a], [mpf(float(x)) for x in u]) for a, u in lines]
    states = []
    for offset_m, offset_rad in [((0, 0, 0), (0, 0, 0)), ((5e-4, -3e-4, 8e-4), (0.05, -0.03, 0.04))]:
        at = [mpf(float(position[i])) + mpf(offset_m[i]) for i in range(3)]
        attitude = product(rotation, exp_so3([mpf(x) for x in offset_rad]))
        value, gradient, hessian = derivatives(exact, at, attitude)
        states.append(
            {
                "position_m": [float(x) for x in at],
                "offset_rad": list(offset_rad),
                "log_likelihood": float(value),
                "gradient": [float(x) for x in gradient],
                "observed_information": [[float(-x) for x in row] for row in hessian],
            }
        )
    document = {
        "program": f"mpmath {mpmath.__version__} at {mp.dps} digits, lines drawn by numpy {np.__version__}",
        "script": "tests/cross/lines_mixture.py",
        "seed": SEED,
        "sigma_m": SIGMA,
        "background": BACKGROUND,
        "disc_radius_m": DISC,
        "markers_capsule_m": MARKERS,
        "rotation_vector_rad": [0.4, -0.8, 0.3],
        "states": states,
        "points_m": [a.tolist() for a, _ in lines],
        "directions": [u.tolist() for _, u in lines],
    }
    text = json.dumps(document).replace("], [", "],\n[").replace('], "', '],\n"')
    Path(__file__).with_suffix(".json").write_text(text + "\n")
    print(states[1]["log_likelihood"], states[1]["gradient"], np.linalg.eigvalsh(states[0]["observed_information"]))


if __name__ == "__main__":
    main()
