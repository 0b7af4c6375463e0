"""The rival of the benchmark: the same identification as the crate's, in NumPy and SciPy.

Place in the flow: `benches/identify.rs` writes a campaign and runs this file on it. Input: a text file, one reading a
row: station, x, y, z, ox, oy, oz, length (m). Output on stdout, first line: seconds of the computing part, number of
unknowns, chi2 per degree of freedom; then value and standard uncertainty of the 18 errors at 21 places each (m, rad),
which the benchmark holds against the crate's. Reading the file and importing are not timed.

The same problem: stations from nothing; residuals with exact rotations; 18 penalties and the exponent of the roughness
profile by restricted likelihood (generalised Fellner-Schall, same prior, same limits and tolerances as
`src/smoothing.rs`); robust weights of three parts with passes until no step exceeds 5e-3 of the uncertainty; covariance
of all unknowns, correlations above 0.9, rank of the low-order problem. The same thrift: rows are linearised anew only
after steps above a micrometre, and re-weighted readings alone are summed again. Partials are those of small angles at
the nominal point: they differ by 1e-4 of themselves, which moves the solution by as little of its uncertainty.
"""

import sys
import time

import numpy as np
from scipy.linalg import eigh, lapack, lstsq
from scipy.interpolate import BSpline

from scipy_lean import CONSTANT_M, INTERVALS, PER_METRE, REPEAT_M, STROKE, basis, directions, place

SETTLED, LINEAR, SMOOTHING_PASSES, UPDATES, DEGREES = 5e-3, 1e-6, 3, 60, 0.01
PLACES = np.linspace(0.0, 1.0, 21)
OPEN = INTERVALS + 2


def width(component, axis):
    """Free coefficients: straightness is zero at both ends."""
    return OPEN - 1 if component < 3 and component != axis else OPEN


ERRORS = [(axis, width(component, axis)) for axis in range(3) for component in range(6)]
STARTS = np.cumsum([0] + [n for _, n in ERRORS])
SQUARE = int(STARTS[-1])
RAM = SQUARE + 3
GEOMETRIC = RAM + 3
RAM_TURN_RAD = 200e-6  # what a ram is believed to be turned by
# Functions of one width are treated as one stack.
STACKS = [(n, np.array([s + np.arange(n) for s, (_, m) in zip(STARTS, ERRORS) if m == n])) for n in (OPEN - 1, OPEN)]


def curvature():
    """f'' of all functions at Gauss points, their shares, and ln 4t(1 - t)."""
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, INTERVALS + 1), np.ones(3)])
    at, share = np.polynomial.legendre.leggauss(4)
    t = ((np.arange(INTERVALS)[:, None] + (at + 1) / 2) / INTERVALS).ravel()
    second = BSpline(knots, np.eye(INTERVALS + 3), 3).derivative(2)(t)
    return second, np.tile(share / 2 / INTERVALS, INTERVALS), np.log(4 * t * (1 - t))


def roughness(curve, exponent):
    """For each stack: matrix, its slope by the exponent, slope of its log determinant, information."""
    second, share, profile = curve
    weight = share * np.exp(exponent * profile)
    found = []
    for n, _ in STACKS:
        own = second[:, 1:n + 1]
        matrix, slope = own.T @ (weight[:, None] * own), own.T @ ((weight * profile)[:, None] * own)
        values, vectors = eigh(matrix, check_finite=False)
        line = 1 if n == OPEN else 0
        curved = vectors[:, line:] / np.sqrt(values[line:])
        rotated = curved.T @ slope @ curved
        found.append((matrix, slope, np.trace(rotated), np.sum(rotated * rotated), n - line))
    return found


def cross(a, b):
    """Row by row; several times faster than np.cross."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def turned(angle, arm):
    """What a rotation moves the end of an arm by."""
    square = (angle * angle).sum(axis=1)[:, None]
    turn = cross(angle, arm)
    return (1 - square / 6) * turn + (0.5 - square / 24) * cross(angle, turn)


class Campaign:
    """What does not change from pass to pass."""

    def __init__(self, data):
        self.station, self.reading = data[:, 0].astype(int), data[:, 1:4]
        self.offset, self.length = data[:, 4:7], data[:, 7]
        self.count = self.station.max() + 1
        nominal = self.reading + self.offset
        members = [self.station == k for k in range(self.count)]
        self.places = np.array([place(nominal[m], self.length[m]) for m in members])
        full = [basis((self.reading[:, k] - low) / (high - low)) for k, (low, high) in enumerate(STROKE)]
        self.bases = [full[axis][:, 1:n + 1] for axis, n in ERRORS]
        self.arm = self.offset - self.offset.mean(axis=0)
        turns = [np.cross(axis, self.arm) for axis in np.eye(3)]
        self.partials = np.stack(directions(self.reading, self.offset) + turns, axis=1)
        self.size = GEOMETRIC + 4 * self.count

    def residuals(self, x):
        """Residual, its uncertainty and line of sight; exact rotations."""
        values = np.stack([b @ x[s:s + b.shape[1]] for b, s in zip(self.bases, STARTS)], axis=1)
        travel = self.reading - [low for low, _ in STROKE]
        c0y, b0z, a0z = x[SQUARE:RAM]
        point = self.offset + turned(np.broadcast_to(x[RAM:GEOMETRIC], self.arm.shape), self.arm)
        for axis in (2, 1, 0):
            shift, angle = values[:, 6 * axis:6 * axis + 3].copy(), values[:, 6 * axis + 3:6 * axis + 6]
            if axis == 1:
                shift[:, 0] -= c0y * travel[:, 1]
            if axis == 2:
                shift[:, 0] += b0z * travel[:, 2]
                shift[:, 1] -= a0z * travel[:, 2]
            shift += turned(angle, point)
            shift[:, axis] += self.reading[:, axis]
            point = point + shift
        at = x[GEOMETRIC:].reshape(-1, 4)[self.station]
        sight = point - at[:, :3]
        distance = np.sqrt((sight * sight).sum(axis=1))
        u = np.sqrt((CONSTANT_M + PER_METRE * distance) ** 2 + REPEAT_M**2)
        return self.length - (distance - at[:, 3]), u, sight / distance[:, None]

    def rows(self, ray):
        """Partials of the predicted lengths."""
        along = np.einsum("nkd,nd->nk", self.partials, ray)
        jacobian = np.zeros((len(ray), self.size))
        for k, (b, s) in enumerate(zip(self.bases, STARTS)):
            np.multiply(along[:, k:k + 1], b, out=jacobian[:, s:s + b.shape[1]])
        jacobian[:, SQUARE:GEOMETRIC] = along[:, 18:]
        first = GEOMETRIC + 4 * self.station
        for d in range(3):
            jacobian[np.arange(len(ray)), first + d] = -ray[:, d]
        jacobian[np.arange(len(ray)), first + 3] = -1.0
        return jacobian


def weigh(standardised):
    """Hampel-like weights: one up to 3.5 robust deviations, zero from 6."""
    size = np.abs(standardised)
    scale = np.partition(size, len(size) // 2)[len(size) // 2] / 0.6744897501960817
    excess = np.clip((size / scale - 3.5) / 2.5, 0.0, 1.0)
    return (1 - excess**2) ** 2


class Smoothness:
    """Penalties of all functions and the exponent they share."""

    def __init__(self, normal):
        self.curve, self.exponent = curvature(), 0.0
        self.rough = roughness(self.curve, 0.0)
        diagonal = np.diag(normal)
        self.factors = [1e-3 * diagonal[i].sum(axis=1) / np.trace(r[0]) for (_, i), r in zip(STACKS, self.rough)]
        self.first = [f.copy() for f in self.factors]

    def solve(self, normal, gradient, square, weight, at, phi):
        """Penalised solve: parameters, inverse, effective degrees of freedom, chi2 per degree of freedom."""
        system, right = normal.copy(), gradient.copy()
        ram = np.arange(RAM, GEOMETRIC)
        stiffness = phi / RAM_TURN_RAD**2
        system[ram, ram] += stiffness
        right[ram] -= stiffness * at[ram]
        for (_, index), own, factors in zip(STACKS, self.rough, self.factors):
            stiffness = phi * factors[:, None, None] * own[0]
            system[index[:, :, None], index[:, None, :]] += stiffness
            right[index] -= np.einsum("fij,fj->fi", stiffness, at[index])
        factor, fail = lapack.dpotrf(system, lower=1, overwrite_a=1)
        if fail:
            raise ArithmeticError("not positive definite")
        change = lapack.dpotrs(factor, right, lower=1)[0]
        inverse = np.tril(lapack.dpotri(factor, lower=1, overwrite_c=1)[0])
        inverse += np.tril(inverse, -1).T
        effective = np.einsum("ij,ij->j", inverse, normal)
        chi2 = square - change @ (2 * gradient - normal @ change)
        return at + change, inverse, effective, chi2 / (weight - effective.sum())

    def choose(self, *problem, phi):
        """Lets the data choose; as `solve`, with the last noise factor."""
        found = self.solve(*problem, phi)
        for _ in range(UPDATES):
            x, inverse, effective, phi = found
            slope, information = 0.0, 0.0
            for k, ((_, index), own) in enumerate(zip(STACKS, self.rough)):
                matrix, by_exponent, log_slope, own_information, rank = own
                covariance = phi * inverse[index[:, :, None], index[:, None, :]]
                values, factors = x[index], self.factors[k]
                spread = np.tensordot(covariance, by_exponent) + ((values @ by_exponent) * values).sum(axis=1)
                slope += factors @ spread - len(factors) * log_slope
                information += len(factors) * own_information
                quadratic = ((values @ matrix) * values).sum(axis=1)
                wanted = np.maximum(rank - factors * np.tensordot(covariance, matrix), 0.0) / (quadratic + 1 / factors)
                wanted = np.clip(wanted, factors / 1e3, factors * 1e3)
                self.factors[k] = np.clip(wanted, self.first[k] / 1e10, self.first[k] * 1e10)
            self.exponent = float(np.clip(self.exponent + np.clip(-slope / information, -0.25, 0.25), 0.0, 2.0))
            self.rough = roughness(self.curve, self.exponent)
            found = self.solve(*problem, phi)
            moved = [np.abs((effective - found[2])[index].sum(axis=1)).max() for _, index in STACKS]
            if max(moved) < DEGREES:
                break
        return found


def low_order_rank(normal):
    """Rank and condition of lines and parabolas, squareness and stations."""
    t = np.linspace(0.0, 1.0, 4 * OPEN + 8)
    full = basis(t)
    shapes = []
    for (_, n), first in zip(ERRORS, STARTS):
        targets = [t**2 - t] if n < OPEN else [t, t**2]
        for column in lstsq(full[:, 1:n + 1], np.column_stack(targets), check_finite=False)[0].T:
            shape = np.zeros(len(normal))
            shape[first:first + n] = column
            shapes.append(shape)
    shapes = np.vstack([shapes, np.eye(len(normal))[SQUARE:]])
    reduced = shapes @ normal @ shapes.T
    scale = 1 / np.sqrt(np.diag(reduced))
    values = eigh(reduced * scale * scale[:, None], eigvals_only=True, check_finite=False)
    if values[0] < 1e-6:
        raise ArithmeticError("the plan does not see all errors")
    return len(values), np.sqrt(values[-1] / values[0])


def correlations(covariance):
    """Pairs of errors, angles and station coordinates with a correlation above 0.9."""
    at, owners, views = basis(np.array([0.25, 0.5, 0.75, 1.0])), [], []
    for error, ((_, n), first) in enumerate(zip(ERRORS, STARTS)):
        block = np.zeros((4, len(covariance)))
        block[:, first:first + n] = at[:, 1:n + 1]
        views.append(block)
        owners += [error] * 4
    views = np.vstack(views + [np.eye(len(covariance))[SQUARE:]])
    owners = np.array(owners + list(range(18, 18 + len(covariance) - SQUARE)))
    joint = views @ covariance @ views.T
    u = np.sqrt(np.maximum(np.diag(joint), 1e-300))
    strong = np.abs(joint) > 0.9 * u * u[:, None]
    return np.argwhere(np.tril(strong & (owners[:, None] != owners)))


def identify(data):
    campaign = Campaign(data)
    x = np.concatenate([np.zeros(GEOMETRIC), campaign.places.ravel()])
    residual, u, ray = campaign.residuals(x)
    weight, at, phi = weigh(residual / u), None, 1.0
    for step in range(30):
        if at is None or np.abs(x - at).max() > LINEAR:
            at, jacobian, target = x, campaign.rows(ray) / u[:, None], residual / u
            rows, change = slice(None), weight
            normal, gradient, square = 0.0, 0.0, 0.0
        else:
            rows = np.flatnonzero(weight != summed)
            change = (weight - summed)[rows]
        weighted = jacobian[rows] * change[:, None]
        normal = normal + weighted.T @ jacobian[rows]
        gradient = gradient + weighted.T @ target[rows]
        square = square + change @ target[rows] ** 2
        summed = weight
        problem = (normal, gradient, square, weight.sum(), at)
        if step == 0:
            low_order_rank(normal)
            smoothness = Smoothness(normal)
        if step < SMOOTHING_PASSES:
            found = smoothness.choose(*problem, phi=phi)
            phi = found[3]
        else:
            found = smoothness.solve(*problem, phi)
        covariance = max(found[3], 1.0) * found[1]
        largest = np.max(np.abs(found[0] - x) / np.sqrt(np.diag(covariance)))
        x = found[0]
        residual, u, ray = campaign.residuals(x)
        weight = weigh(residual / u)
        if largest < SETTLED:
            correlations(covariance)
            return x, covariance, found[3]
    raise ArithmeticError("not settled")


def curves(x, covariance):
    """Value and uncertainty of each error at equal places along its axis."""
    at = basis(PLACES)
    for (_, n), first in zip(ERRORS, STARTS):
        own, block = at[:, 1:n + 1], slice(first, first + n)
        u = np.sqrt(np.maximum(((own @ covariance[block, block]) * own).sum(axis=1), 0.0))
        yield from zip(own @ x[block], u)


if __name__ == "__main__":
    readings = np.loadtxt(sys.argv[1])
    identify(readings)  # warms imports and BLAS up
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        x, covariance, chi2 = identify(readings)
        times.append(time.perf_counter() - begin)
    print(f"{sorted(times)[len(times) // 2]:.6f} {len(x)} {chi2:.6f}")
    for value, u in curves(x, covariance):
        print(f"{value:.12e} {u:.6e}")
