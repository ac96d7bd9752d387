#!/usr/bin/env python3
"""Gyroscope with a bias that walks, and gravity, through an error-state Kalman filter in NumPy -> gyro_gravity.json (beside
this file). Rotation matrices, textbook gain and Joseph form: nothing in common with the Rust filter but its equations.

Versions: Python 3.11, numpy 1.26.4.   Run: python3 gyro_gravity.py   Seed 20261122.

Error [dtheta (3, capsule), db (3)]. Over dt with the mean rate w = gyro - b and J = J_r(w dt):
    R' = R Exp(w dt)     dtheta' = Exp(-w dt) dtheta - dt J db     noise dt^2 sigma^2 J J^T, biases walk
Gravity: z = -R^T g + noise, H = [(-R^T g)x, 0].
Correction by d = [x, y, z]: R' = R Exp([0, y, z]) Exp([x, 0, 0]), then P' = G P G^T with
G = [e_x, Exp(-[x, 0, 0]) J_r([0, y, z]) [e_y e_z]].
Readings are rounded to 1e-9 before they are used.
"""

import json
from pathlib import Path

import numpy as np

SEED, STEPS, DT, EVERY = 20261122, 1200, 0.05, 5
GYRO, ACCELEROMETER, WALK = 0.02, 0.05, 5e-4
PRIOR_RAD, PRIOR_BIAS = 0.05, 0.05
BIAS = np.array([0.03, -0.02, 0.05])
GRAVITY = np.array([0.0, -9.81, 0.0])


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def exp(v):
    angle, k = np.linalg.norm(v), skew(v)
    if angle < 1e-5:
        return np.eye(3) + k + k @ k / 2 + k @ k @ k / 6
    return np.eye(3) + np.sin(angle) / angle * k + 2 * np.sin(angle / 2) ** 2 / angle**2 * k @ k


def right_jacobian(v):
    angle, k = np.linalg.norm(v), skew(v)
    if angle < 1e-2:
        return np.eye(3) - k / 2 + k @ k / 6 - k @ k @ k / 24 + k @ k @ k @ k / 120 - k @ k @ k @ k @ k / 720
    return np.eye(3) - (1 - np.cos(angle)) / angle**2 * k + (angle - np.sin(angle)) / angle**3 * k @ k


def log(r):
    """Angles well below pi only."""
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    sine = np.linalg.norm(v)
    angle = np.arctan2(sine, (np.trace(r) - 1) / 2)
    return v * (angle / sine if sine > 1e-9 else 1.0)


def rate_at(t):
    return np.array([0.5 * np.sin(0.7 * t), 0.4 * np.cos(0.45 * t), 0.6 * np.sin(0.3 * t + 1.0)])


def main():
    rng = np.random.default_rng(SEED)
    truth, bias = exp(np.array([0.2, 0.4, -0.3])), BIAS.copy()
    prior_vector = np.round(log(truth @ exp(PRIOR_RAD * rng.standard_normal(3))), 9)
    r, b = exp(prior_vector), np.zeros(3)
    p = np.diag(np.repeat([PRIOR_RAD**2, PRIOR_BIAS**2], 3))
    gyro, accelerometer, history, tilt, truths = [], [], [], [], []
    for k in range(1, STEPS + 1):
        rate = rate_at((k - 0.5) * DT)
        truth = truth @ exp(rate * DT)
        z = np.round(rate + bias + GYRO * rng.standard_normal(3), 9)
        bias = bias + WALK * np.sqrt(DT) * rng.standard_normal(3)
        gyro.append(z.tolist())
        turn = (z - b) * DT
        j = right_jacobian(turn) * DT
        f = np.block([[exp(-turn), -j], [np.zeros((3, 3)), np.eye(3)]])
        p = f @ p @ f.T
        p[:3, :3] += GYRO**2 * j @ j.T
        p[3:, 3:] += WALK**2 * DT * np.eye(3)
        r = r @ exp(turn)
        if k % EVERY:
            continue
        a = np.round(-truth.T @ GRAVITY + ACCELEROMETER * rng.standard_normal(3), 9)
        accelerometer.append(a.tolist())
        predicted = -r.T @ GRAVITY
        h = np.hstack([skew(predicted), np.zeros((3, 3))])
        s = h @ p @ h.T + ACCELEROMETER**2 * np.eye(3)
        gain = np.linalg.solve(s, h @ p).T
        innovation = a - predicted
        error = gain @ innovation
        left = np.eye(6) - gain @ h
        p = left @ p @ left.T + ACCELEROMETER**2 * gain @ gain.T
        pointing, roll = np.array([0, error[1], error[2]]), np.array([error[0], 0, 0])
        r = r @ exp(pointing) @ exp(roll)
        b = b + error[3:]
        reset = np.eye(6)
        reset[:3, 1:3] = (exp(-roll) @ right_jacobian(pointing))[:, 1:]
        p = reset @ p @ reset.T
        down, true_down = r.T @ GRAVITY / 9.81, truth.T @ GRAVITY / 9.81
        tilt.append(float(np.arctan2(np.linalg.norm(np.cross(down, true_down)), down @ true_down)))
        history.append([*r.flatten().tolist(), *b.tolist(), *np.diag(p).tolist(), float(innovation @ np.linalg.solve(s, innovation))])
        truths.append([*np.round(log(truth), 12).tolist(), *np.round(bias, 12).tolist()])
    document = {
        "program": f"NumPy {np.__version__}, this script's own filter",
        "script": "tests/cross/gyro_gravity.py",
        "seed": SEED,
        "step_s": DT,
        "every": EVERY,
        "gyro_sigma_rad_s": GYRO,
        "accelerometer_sigma_m_s2": ACCELEROMETER,
        "bias_random_walk_rad_s_per_sqrt_s": WALK,
        "prior_sigma_rad": PRIOR_RAD,
        "prior_bias_sigma_rad_s": PRIOR_BIAS,
        "prior_rotation_vector_rad": prior_vector.tolist(),
        "gravity_world_m_s2": GRAVITY.tolist(),
        "history_layout": "rotation matrix by rows (9), bias (3), variances of dtheta and db (6), nis",
        "gyro_rad_s": gyro,
        "accelerometer_m_s2": accelerometer,
        "history": history,
        "tilt_error_rad": tilt,
        "last_true_bias_rad_s": truths[-1][3:],
    }
    text = json.dumps(document).replace("], [", "],\n[").replace('], "', '],\n"')
    Path(__file__).with_suffix(".json").write_text(text + "\n")
    print("tilt", np.degrees(np.sqrt(np.mean(np.square(tilt[60:])))), "deg rms, bias error", b - bias, np.sqrt(np.diag(p)[3:]))
    print("mean NIS", np.mean([row[-1] for row in history]))


if __name__ == "__main__":
    main()
