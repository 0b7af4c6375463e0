"""The third rival of the benchmark: the problem as one writes it with SciPy's own solver.

Place in the flow: `benches/identify.rs` writes a campaign and runs this file on it; input and first line of output are
those of `scipy_identify.py`. Reading the file and importing are not timed.

What it does: stations from nothing (as `scipy_lean.py`), then `scipy.optimize.least_squares` (trust region, analytic
Jacobian, dense) on errors, squareness, stations and dead paths together, with the second differences of the splines as
extra residuals; their one factor is chosen by generalised cross-validation among four, each fit starting where the last
ended; a robust loss (soft L1) in the final fit; covariance of all unknowns from its Jacobian. No hand-made normal
equations: it is the rival for who would otherwise take the library, `scipy_identify.py` the one for who would write
this crate in NumPy.
"""

import sys
import time

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares

from scipy_lean import CONSTANT_M, INTERVALS, PER_METRE, REPEAT_M, STROKE, basis, directions, place


class Problem:
    """Residuals in units of their uncertainty, and their Jacobian."""

    def __init__(self, data):
        self.station, self.reading, self.offset = data[:, 0].astype(int), data[:, 1:4], data[:, 4:7]
        self.length, self.nominal = data[:, 7], data[:, 1:4] + data[:, 4:7]
        self.count = self.station.max() + 1
        self.columns = directions(self.reading, self.offset)
        second = np.diff(np.eye(INTERVALS + 3), n=2, axis=0)
        self.bases, blocks = [], []
        for axis in range(3):
            lower, upper = STROKE[axis]
            full = basis((self.reading[:, axis] - lower) / (upper - lower))
            for component in range(6):
                last = INTERVALS + 2 if component < 3 and component != axis else INTERVALS + 3
                self.bases.append(full[:, 1:last])
                blocks.append(second[:, 1:last])
        self.starts = np.cumsum([0] + [b.shape[1] for b in self.bases])
        self.geometric = self.starts[-1] + 3
        self.size = self.geometric + 4 * self.count
        self.rough = np.zeros((sum(len(b) for b in blocks), self.size))
        row = 0
        for block, start in zip(blocks, self.starts):
            self.rough[row:row + len(block), start:start + block.shape[1]] = block
            row += len(block)

    def start(self):
        places = [place(self.nominal[self.station == k], self.length[self.station == k]) for k in range(self.count)]
        return np.concatenate([np.zeros(self.geometric), np.ravel(places)])

    def sight(self, x):
        moved = sum(
            c * (b @ x[s:s + b.shape[1]])[:, None] for c, b, s in zip(self.columns[:18], self.bases, self.starts)
        ) + sum(c * e for c, e in zip(self.columns[18:], x[self.starts[-1]:self.geometric]))
        places = x[self.geometric:].reshape(self.count, 4)[self.station]
        sight = self.nominal + moved - places[:, :3]
        distance = np.linalg.norm(sight, axis=1)
        u = np.sqrt((CONSTANT_M + PER_METRE * distance) ** 2 + REPEAT_M**2)
        return sight / distance[:, None], distance - places[:, 3], u

    def residuals(self, x, factor):
        _, predicted, u = self.sight(x)
        return np.concatenate([(predicted - self.length) / u, factor * (self.rough @ x)])

    def jacobian(self, x, factor):
        ray, _, u = self.sight(x)
        jacobian = np.zeros((len(self.length), self.size))
        for c, b, s in zip(self.columns[:18], self.bases, self.starts):
            jacobian[:, s:s + b.shape[1]] = (c * ray).sum(axis=1)[:, None] * b
        for k, c in enumerate(self.columns[18:]):
            jacobian[:, self.starts[-1] + k] = (c * ray).sum(axis=1)
        for k in range(self.count):
            rows = self.station == k
            jacobian[rows, self.geometric + 4 * k:self.geometric + 4 * k + 3] = -ray[rows]
            jacobian[rows, self.geometric + 4 * k + 3] = -1.0
        return np.vstack([jacobian / u[:, None], factor * self.rough])

    def fit(self, x, factor, loss):
        return least_squares(
            self.residuals, x, jac=self.jacobian, args=(factor,), method="trf", x_scale="jac", loss=loss, f_scale=3.0
        )


def identify(data):
    problem, n = Problem(data), len(data)
    x, best = problem.start(), (np.inf, None)
    for factor in 10.0 ** np.arange(4.0, 8.0):
        found = problem.fit(x, factor, "linear")
        x = found.x
        normal, own = found.jac.T @ found.jac, found.jac[:n].T @ found.jac[:n]
        freedom = n - np.trace(cho_solve(cho_factor(normal), own))
        score = n * np.sum(found.fun[:n] ** 2) / freedom**2
        if score < best[0]:
            best = (score, factor, freedom, x)
    _, factor, freedom, x = best
    found = problem.fit(x, factor, "soft_l1")
    covariance = cho_solve(cho_factor(found.jac.T @ found.jac), np.eye(problem.size))
    assert np.all(np.diag(covariance) > 0)
    return problem.size, float(np.sum(problem.residuals(found.x, factor)[:n] ** 2) / freedom)


if __name__ == "__main__":
    readings = np.loadtxt(sys.argv[1])
    identify(readings[:600])  # warms imports and BLAS up
    begin = time.perf_counter()
    unknowns, chi2 = identify(readings)
    print(f"{time.perf_counter() - begin:.6f} {unknowns} {chi2:.4f}")
