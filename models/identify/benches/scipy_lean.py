"""The lean rival of the benchmark: an easier problem than ours in NumPy and SciPy, and parts of the full rival.

Place in the flow: `benches/identify.rs` writes a campaign and runs this file on it; `scipy_identify.py`, which solves
the same problem as the crate, takes its basis, stations and small-angle partials from here. Input: a text file, one
reading a row: station, x, y, z, ox, oy, oz, length (m). Output on stdout: seconds of the computing part, number of
unknowns, chi2 per degree of freedom. Reading the file and importing are not timed.

What it does: stations from nothing by the linearised range equation; all 18 error functions as cubic B-splines
(small-angle chain of a moving bridge, bed -> X -> Y -> Z), squareness, stations and dead paths by Gauss-Newton with an
analytic, vectorised Jacobian; second-difference penalty, one factor for linear and one for angular errors chosen by
generalised cross-validation on a grid; normal equations by BLAS. What it leaves out: a factor for each function, the
profile of roughness, robust weights, exact rotations, rank and correlations.
"""

import sys
import time

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve

INTERVALS = int(sys.argv[2]) if len(sys.argv) > 2 else 9
STROKE = [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)]
CONSTANT_M, PER_METRE, REPEAT_M = 0.025e-6, 0.15e-6, 0.25e-6


def basis(t):
    """Clamped cubic B-splines at t in 0 ... 1, all columns."""
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, INTERVALS + 1), np.ones(3)])
    return BSpline.design_matrix(np.clip(t, 0.0, 1.0), knots, 3).toarray()


def place(points, length):
    """Station and dead path from nominal points: linear, then Gauss-Newton with weights against outliers."""
    centre = points.mean(axis=0)
    p = points - centre
    matrix = np.column_stack([2 * p, 2 * length, -np.ones(len(p))])
    solution = np.linalg.lstsq(matrix, (p**2).sum(axis=1) - length**2, rcond=None)[0]
    station = np.append(solution[:3] + centre, solution[3])
    for _ in range(8):
        sight = points - station[:3]
        distance = np.linalg.norm(sight, axis=1)
        residual = length - (distance - station[3])
        scale = max(np.median(np.abs(residual)) / 0.6745, 1e-6)
        weight = 1.0 / np.maximum(1.0, np.abs(residual) / (3 * scale))
        jacobian = np.column_stack([-sight / distance[:, None], -np.ones(len(points))]) * weight[:, None]
        station = station + np.linalg.lstsq(jacobian, residual * weight, rcond=None)[0]
    return station


def arms(reading, offset):
    """What hangs on each axis of the bridge: its rotations turn this about its own pivot."""
    x, y, z = reading.T
    zero = np.zeros_like(x)
    on_z = offset
    on_y = offset + np.column_stack([zero, zero, z])
    on_x = offset + np.column_stack([zero, y, z])
    return [on_x, on_y, on_z]


def directions(reading, offset):
    """Partials of the point by the 18 errors and 3 squareness angles, each readings x 3; small angles."""
    columns = []
    for arm in arms(reading, offset):
        for d in range(3):
            columns.append(np.broadcast_to(np.eye(3)[d], arm.shape))
        for d in range(3):
            columns.append(np.cross(np.eye(3)[d], arm))
    y, z = reading[:, 1] - STROKE[1][0], reading[:, 2] - STROKE[2][0]
    zero = np.zeros_like(y)
    columns.append(np.column_stack([-y, zero, zero]))  # C0Y tilts Y about Z
    columns.append(np.column_stack([z, zero, zero]))  # B0Z tilts Z about Y
    columns.append(np.column_stack([zero, -z, zero]))  # A0Z tilts Z about X
    return columns


def identify(data):
    station, reading, offset, length = data[:, 0].astype(int), data[:, 1:4], data[:, 4:7], data[:, 7]
    count = station.max() + 1
    nominal = reading + offset
    places = np.array([place(nominal[station == k], length[station == k]) for k in range(count)])

    bases, widths, penalties = [], [], []
    second = np.diff(np.eye(INTERVALS + 3), n=2, axis=0)
    for axis in range(3):
        lower, upper = STROKE[axis]
        full = basis((reading[:, axis] - lower) / (upper - lower))
        for component in range(6):
            last = INTERVALS + 2 if component < 3 and component != axis else INTERVALS + 3
            bases.append(full[:, 1:last])
            difference = second[:, 1:last]
            penalties.append((component >= 3, difference.T @ difference))
            widths.append(last - 1)
    geometric = sum(widths) + 3
    size = geometric + 4 * count
    rough = [np.zeros((size, size)), np.zeros((size, size))]
    first = 0
    for width, (angular, matrix) in zip(widths, penalties):
        rough[int(angular)][first:first + width, first:first + width] = matrix
        first += width

    errors = np.zeros(geometric)
    columns = directions(reading, offset)
    starts = np.cumsum([0] + widths)
    chosen = None
    for step in range(6):
        moved = sum(
            c * (b @ errors[s:s + b.shape[1]])[:, None] for c, b, s in zip(columns[:18], bases, starts)
        ) + sum(c * e for c, e in zip(columns[18:], errors[-3:]))
        sight = nominal + moved - places[station, :3]
        distance = np.linalg.norm(sight, axis=1)
        ray = sight / distance[:, None]
        residual = length - (distance - places[station, 3])
        u = np.sqrt((CONSTANT_M + PER_METRE * distance) ** 2 + REPEAT_M**2)
        jacobian = np.zeros((len(data), size))
        for c, b, s in zip(columns[:18], bases, starts):
            jacobian[:, s:s + b.shape[1]] = (c * ray).sum(axis=1)[:, None] * b
        for k, c in enumerate(columns[18:]):
            jacobian[:, starts[-1] + k] = (c * ray).sum(axis=1)
        for k in range(count):
            rows = station == k
            jacobian[rows, geometric + 4 * k:geometric + 4 * k + 3] = -ray[rows]
            jacobian[rows, geometric + 4 * k + 3] = -1.0
        weighted = jacobian / u[:, None]
        target = residual / u
        normal = weighted.T @ weighted
        x = np.concatenate([errors, places.ravel()])
        gradient = weighted.T @ target

        def solve(factors):
            penalty = factors[0] * rough[0] + factors[1] * rough[1]
            factor = cho_factor(normal + penalty, check_finite=False)
            change = cho_solve(factor, gradient - penalty @ x, check_finite=False)
            return change, factor

        if step < 2:
            # Generalised cross-validation on a grid of the two factors.
            best = np.inf
            scale = np.trace(normal[:geometric, :geometric]) / geometric
            for linear in scale * 10.0 ** np.arange(-6.0, 1.0):
                for angular in scale * 10.0 ** np.arange(-6.0, 1.0):
                    change, factor = solve((linear, angular))
                    misfit = target - weighted @ change
                    degrees = np.trace(cho_solve(factor, normal, check_finite=False))
                    score = len(data) * (misfit @ misfit) / (len(data) - degrees) ** 2
                    if score < best:
                        best, chosen, freedom = score, (linear, angular), degrees
        change, factor = solve(chosen)
        errors = errors + change[:geometric]
        places = places + change[geometric:].reshape(count, 4)
        covariance = cho_solve(factor, np.eye(size), check_finite=False)
        if np.max(np.abs(change) / np.sqrt(np.diag(covariance))) < 5e-3:
            break
    misfit = target - weighted @ change
    return size, float(misfit @ misfit / (len(data) - freedom))


if __name__ == "__main__":
    readings = np.loadtxt(sys.argv[1])
    identify(readings[:600])  # warms imports and BLAS up
    begin = time.perf_counter()
    unknowns, chi2 = identify(readings)
    print(f"{time.perf_counter() - begin:.6f} {unknowns} {chi2:.4f}")
