#!/usr/bin/env python3
"""Reference values of the finite cylinder's field and gradient -> fields_reference.csv (beside this file).

Versions: Python 3.11, mpmath 1.3.0, magpylib 5.2.3, numpy 2.4.6.   Run: python3 fields_reference.py
Seed 20261122 (directions of the points only).

mpmath: the azimuthal integral of the current sheet at 50 digits (no elliptic integral in it, so it is
independent of derby2010):

    d^2 = a^2 + rho^2 - 2 a rho cos(phi),  R+- = sqrt(d^2 + z+-^2),  z+- = z +- b
    B_z   = Br/(2 pi) int_0^pi a (a - rho cos phi)/d^2 [z+/R+ - z-/R-] dphi
    B_rho = Br/(2 pi) int_0^pi a cos phi [1/R- - 1/R+] dphi
    dB_z/dz and dB_rho/dz: the same integrals with the integrand's derivative

and, as a check of the quadrature, derby2010 with mpmath's own elliptic integrals at 50 digits, which has to
agree to 1e-30. magpylib: Cylinder.getB (closed form, double precision).
"""

import csv
import platform
from pathlib import Path

import magpylib
import mpmath
import numpy as np
from mpmath import mp, mpf

mp.dps = 50
SEED = 20261122
MU0 = 4e-7 * np.pi

SOURCES = {  # name: (radius_m, half_length_m, remanence_tesla)
    "epm": (0.0508, 0.0508, 1.48),
    "coil": (0.09, 0.02, MU0 * 160 * 0.71 / 0.04),
    "capsule_magnet": (0.0025, 0.003, 1.2938),
    "rod": (0.001, 0.01, 1.2),
    "disc": (0.01, 0.0005, 1.2),
}


def face_pair(a, b, br, rho, z):
    """B_rho, B_z, dB_rho/dz, dB_z/dz by quadrature."""
    up, low = z + b, z - b
    nodes = [mpf(0), mp.pi]
    gap = mp.sqrt((rho - a) ** 2 + min(abs(up), abs(low)) ** 2) / a
    cut = gap
    while cut < 1:  # the integrand's width near phi = 0 is the distance to the sheet
        nodes.append(cut)
        cut *= 4
    nodes.sort()

    def terms(phi):
        cos = mp.cos(phi)
        d2 = a * a + rho * rho - 2 * a * rho * cos
        plus, minus = mp.sqrt(d2 + up * up), mp.sqrt(d2 + low * low)
        lever = a * (a - rho * cos)
        return (
            a * cos * (1 / minus - 1 / plus),
            lever / d2 * (up / plus - low / minus),
            a * cos * (up / plus**3 - low / minus**3),
            lever * (1 / plus**3 - 1 / minus**3),
        )

    scale = br / (2 * mp.pi)
    return [scale * mp.quad(lambda phi, i=i: terms(phi)[i], nodes) for i in range(4)]


def derby(a, b, br, rho, z):
    """B_rho, B_z of derby2010 with mpmath's complete elliptic integrals (rho != a, rho > 0)."""
    g = (a - rho) / (a + rho)
    radial, axial = mpf(0), mpf(0)
    for sign, height in ((1, z + b), (-1, z - b)):
        norm2 = height**2 + (rho + a) ** 2
        m = 1 - (height**2 + (a - rho) ** 2) / norm2
        k, e, n = mp.ellipk(m), mp.ellipe(m), 1 - g * g
        pi_n = mp.ellippi(n, m)
        radial += sign * a / mp.sqrt(norm2) * (2 * (e - (1 - m) * k) / m - k)
        # (cos^2 + g sin^2) = (g^2 sin^2 + cos^2)/(1 + g) ... written by K and Pi
        axial += sign * height / mp.sqrt(norm2) * ((1 - g) / n * k + (1 - (1 - g) / n) * pi_n)
    return br / mp.pi * radial, br / mp.pi * a / (a + rho) * axial


def reference(source, point):
    """Bx, By, Bz and Gxx, Gxy, Gxz, Gyy, Gyz, Gzz at 50 digits."""
    a, b, br = (mpf(float(v)) for v in source)
    x, y, z = (mpf(float(v)) for v in point)
    rho = mp.sqrt(x * x + y * y)
    b_rho, b_z, w_rho, q = face_pair(a, b, br, rho, z)
    if rho == 0:
        t = -q / 2
        return [mpf(0), mpf(0), b_z, t, mpf(0), mpf(0), t, mpf(0), q]
    check_rho, check_z = derby(a, b, br, rho, z)
    size = mp.sqrt(b_rho**2 + b_z**2)
    assert abs(check_rho - b_rho) < mpf("1e-30") * size and abs(check_z - b_z) < mpf("1e-30") * size
    t, w, cx, cy = b_rho / rho, w_rho, x / rho, y / rho
    h = -(q + 2 * t)
    return [
        b_rho * cx, b_rho * cy, b_z,
        t + h * cx * cx, h * cx * cy, w * cx, t + h * cy * cy, w * cy, q,
    ]  # fmt: skip


def points(rng):
    """(kind, source name, point) for every row."""
    ratios = [1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2, 2.5, 3, 4, 5, 7, 10]
    far = [11.2, 11.4, 13, 15, 20, 30, 50, 100, 200, 500, 1000, 2000, 3000]
    for name, (a, b, _) in SOURCES.items():
        for ratio in ratios + far:
            direction = rng.normal(size=3)
            point = ratio * a * direction / np.linalg.norm(direction)
            inside = np.hypot(point[0], point[1]) < a and abs(point[2]) < b
            yield ("inside" if inside else "shell", name, point)
        for ratio in (0.0, 0.5, 1.05, 2, 5, 10, 30, 300):
            yield "axis", name, np.array([0.0, 0.0, ratio * a])
        for ratio in (1.05, 2, 6, 10, 30, 300):
            angle = rng.uniform(0, 2 * np.pi)
            yield "mid_plane", name, ratio * a * np.array([np.cos(angle), np.sin(angle), 0.0])
        for gap in (1e-1, 1e-2, 1e-3, 1e-6):
            angle, turn = rng.uniform(0, np.pi / 2), rng.uniform(0, 2 * np.pi)
            rho, z = a * (1 + gap * np.cos(angle)), b + a * gap * np.sin(angle)
            yield "near_edge", name, np.array([rho * np.cos(turn), rho * np.sin(turn), z])
        for near in (1e-3, 1e-6, 1e-10):
            yield "near_axis", name, np.array([near * a, -0.5 * near * a, 3 * max(a, b)])


def main():
    assert (mpmath.__version__, magpylib.__version__) == ("1.3.0", "5.2.3")
    path = Path(__file__).with_suffix(".csv")
    rng = np.random.default_rng(SEED)
    with path.open("w", newline="") as file:
        file.write(f"# program: mpmath {mpmath.__version__} (50 digits), magpylib {magpylib.__version__}, ")
        file.write(f"numpy {np.__version__}, Python {platform.python_version()}\n")
        file.write(f"# script: tests/cross/fields_reference.py, seed {SEED}\n")
        writer = csv.writer(file, lineterminator="\n")
        header = "kind source radius_m half_length_m remanence_tesla x_m y_m z_m".split()
        header += [f"b{c}_tesla" for c in "xyz"]
        header += [f"g{c}_tesla_per_m" for c in ("xx", "xy", "xz", "yy", "yz", "zz")]
        header += [f"magpylib_b{c}_tesla" for c in "xyz"]
        writer.writerow(header)
        for kind, name, point in points(rng):
            source = SOURCES[name]
            a, b, br = source
            magnet = magpylib.magnet.Cylinder(polarization=(0, 0, br), dimension=(2 * a, 2 * b))
            numbers = [float(v) for v in (*source, *point)]
            exact = [float(v) for v in reference(source, point)]
            peer = [float(v) for v in magnet.getB(point)]
            writer.writerow([kind, name, *(repr(v) for v in (*numbers, *exact, *peer))])


if __name__ == "__main__":
    main()
