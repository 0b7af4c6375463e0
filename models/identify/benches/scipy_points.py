"""The fit of measured positions with scipy.optimize: least_squares and differential_evolution on the same points.

Run by benches/jade.rs: scipy_points.py FILE DEGREE EVALUATIONS MEMBERS. FILE holds a point a line: reading, offset, measured
position (m). The objective is that of abbe_identify::points with squared distances: small-angle chain X, Y, Z on the tool
side, polynomials in integrated Legendre form with the constraints built in, squareness C0Y, B0Z, A0Z, pose of the measuring
frame. Evaluation is vectorised over the population. Prints a line a method: name, seconds, objective / u^2,
evaluations; the second method only where MEMBERS is not 0.
"""

import sys
import time

import numpy as np
from scipy.optimize import differential_evolution, least_squares

STROKE = np.array([0.8, 0.6, 0.6])
U = 0.3e-6


def legendre_integrals(t, degree):
    """t, then the integrals from 0 to t of the shifted Legendre polynomials: (points, degree)."""
    x = 2.0 * t - 1.0
    p = [np.ones_like(x), x]
    for n in range(1, degree + 1):
        p.append(((2 * n + 1) * x * p[n] - n * p[n - 1]) / (n + 1))
    columns = [t] + [(p[k + 1] - p[k - 1]) / (2.0 * (2 * k + 1)) for k in range(1, degree)]
    return np.stack(columns, axis=1)


class Problem:
    def __init__(self, rows, degree):
        self.reading, self.offset, self.measured = rows[:, :3], rows[:, 3:6], rows[:, 6:9]
        self.bases, self.layout, size = [], [], 0
        for axis in range(3):
            basis = legendre_integrals(self.reading[:, axis] / STROKE[axis], degree)
            for component in range(6):
                straight = component < 3 and component != axis
                own = basis[:, 1:] if straight else basis
                self.layout.append((size, own))
                size += own.shape[1]
        self.squareness = size
        self.size = size + 3 + 6
        self.middle = self.measured.mean(axis=0)

    def residuals(self, x):
        """x: (members, size) -> (members, points, 3), in units of U."""
        x = np.atleast_2d(x)
        values = [x[:, first:first + basis.shape[1]] @ basis.T for first, basis in self.layout]
        c0y, b0z, a0z = (x[:, self.squareness + k, None] for k in range(3))
        point = np.broadcast_to(self.offset, (len(x),) + self.offset.shape)
        for axis in (2, 1, 0):
            dx, dy, dz, a, b, c = values[6 * axis:6 * axis + 6]
            turned = np.cross(np.stack([a, b, c], axis=2), point)
            shift = np.stack([dx, dy, dz], axis=2)
            travel = self.reading[:, axis]
            shift[:, :, axis] += travel
            if axis == 1:
                shift[:, :, 0] -= c0y * travel
            if axis == 2:
                shift[:, :, 0] += b0z * travel
                shift[:, :, 1] -= a0z * travel
            point = point + turned + shift
        frame = x[:, -6:]
        turn, arm = frame[:, None, 3:], point - self.middle
        # The turn of the frame is below 1e-3: the second order is enough to 1e-9.
        first = np.cross(np.broadcast_to(turn, arm.shape), arm)
        second = np.cross(np.broadcast_to(turn, arm.shape), first)
        return (self.measured - (point + first + 0.5 * second + frame[:, None, :3])) / U

    def objective(self, x):
        return np.square(self.residuals(x)).sum(axis=(1, 2))


def main():
    rows = np.loadtxt(sys.argv[1])
    degree, evaluations, members = (int(v) for v in sys.argv[2:5])
    problem = Problem(rows, degree)
    start = np.zeros(problem.size)

    begin = time.perf_counter()
    found = least_squares(lambda x: problem.residuals(x).ravel(), start, method="lm", x_scale=1e-5)
    print("least_squares", time.perf_counter() - begin, 2.0 * found.cost, found.nfev)

    if members == 0:
        return
    # The estimate itself is left out of the population, so that something is left to find.
    jacobian = found.jac
    deviation = 3.0 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    generator = np.random.default_rng(1)
    first = found.x + deviation * generator.standard_normal((members, problem.size))
    bounds = np.stack([found.x - 20.0 * deviation, found.x + 20.0 * deviation], axis=1)
    begin = time.perf_counter()
    calls = []

    def objective(x):
        calls.append(x.shape[1])
        return problem.objective(x.T)

    best = differential_evolution(
        objective, bounds, strategy="currenttobest1bin", init=np.clip(first, bounds[:, 0], bounds[:, 1]),
        maxiter=max(evaluations // members - 1, 1), tol=0.0, atol=0.0, polish=False, vectorized=True, updating="deferred", seed=1,
    )
    print("differential_evolution", time.perf_counter() - begin, best.fun, sum(calls))


main()
