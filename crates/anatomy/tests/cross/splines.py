"""Expected values for tests/anatomy.rs, `cross_` tests: the not-a-knot cubic spline and PCHIP of SciPy.

Made with SciPy 1.17.1, NumPy (any): python3 splines.py > splines.csv
Columns: kind (spline: x, y, z in m at the parameter u; pchip: radius in m and slope at the arc length u), u, a, b, c
"""
import numpy as np
import scipy
from scipy.interpolate import CubicSpline, PchipInterpolator

POINTS = np.array([[0.00, 0.00, 0.00], [0.01, 0.004, 0.001], [0.016, 0.013, 0.004], [0.014, 0.026, 0.003],
                   [0.001, 0.031, -0.006], [-0.012, 0.024, -0.010], [-0.015, 0.012, -0.008]])
RADII = [(0.0, 0.010), (0.01, 0.020), (0.03, 0.022), (0.04, 0.015), (0.07, 0.016)]

print(f"# SciPy {scipy.__version__}, made by splines.py (no randomness). kind, u (m), then x, y, z (m) or radius (m), slope (1), 0")
print("kind,u,a,b,c")
u = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1))]
spline = CubicSpline(u, POINTS, bc_type="not-a-knot")
for x in np.linspace(0.0, u[-1], 29):
    print("spline," + ",".join(f"{v:.17e}" for v in (x, *spline(x))))
pchip = PchipInterpolator(*zip(*RADII))
for x in np.linspace(0.0, 0.07, 29)[1:-1]:
    print(f"pchip,{x:.17e},{pchip(x):.17e},{pchip.derivative()(x):.17e},0")
