"""The rival of the benchmark: every smooth candidate of residual vectors refitted by SciPy.

Place in the flow: `benches/studies.rs` writes the data and runs this file on it. Input: a file, a line a vector: residuals x y z (m),
position x y z (m), time (s), logged quantities. Output: the candidate that is least probable by chance, the decimal logarithm of
that probability, the number of refits and their seconds, and the seconds of the same tests by normal equations, with tabs between.
Seconds are those of the processor, without what else it does; reading the file and importing are not timed.

Base: a rigid motion of the frame, over all three components, each weighted by the deviation that the base leaves of it.
Candidates: Legendre polynomials of one quantity (degree 1, 2, 4) and of two (product; total degree 2, 3), in each component. Each
is fitted together with the base by `scipy.linalg.lstsq`; the F test takes the component that it acts on. Then all are tested
again as by hand in NumPy: from the columns' products with each other, with the base and with what it leaves.
"""

import sys
import time

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.linalg import lstsq
from scipy.stats import f as fisher

IN_PAIRS = 16


def main():
    table = np.loadtxt(sys.argv[1])
    residuals, positions = table[:, :3], table[:, 3:6]
    names = ["x_m", "y_m", "z_m", "time_s"] + [f"q_{k:02}" for k in range(table.shape[1] - 7)]
    values = table[:, 3:]
    low, high = values.min(axis=0), values.max(axis=0)
    powers = [legvander(2 * (values[:, k] - low[k]) / (high[k] - low[k]) - 1, 4) for k in range(values.shape[1])]
    count = len(table)
    arms = positions - positions.mean(axis=0)
    base = np.zeros((3 * count, 6))
    for d in range(3):
        rows = slice(d * count, (d + 1) * count)
        base[rows, d] = 1
        for about in range(3):
            axis = np.eye(3)[about]
            base[rows, 3 + about] = np.cross(axis, arms)[:, d]
    observed = residuals.T.reshape(-1)
    weights = np.ones(3 * count)
    for _ in range(5):
        solved = lstsq(base * weights[:, None], observed * weights)[0]
        left = observed - base @ solved
        for d in range(3):
            rows = slice(d * count, (d + 1) * count)
            weights[rows] = 1 / np.sqrt(np.mean(left[rows] ** 2))
    weighted, target = base * weights[:, None], observed * weights
    hat = np.linalg.qr(weighted)[0]
    left = target - hat @ (hat.T @ target)

    shapes = []
    for k, name in enumerate(names):
        shapes += [(f"smooth in {name}, degree {degree}", powers[k][:, 1 : degree + 1]) for degree in (1, 2, 4)]
    for i in range(min(IN_PAIRS, len(names))):
        for j in range(i + 1, min(IN_PAIRS, len(names))):
            p, q = powers[i], powers[j]
            shapes.append((f"product of {names[i]} and {names[j]}", p[:, 1:2] * q[:, 1:2]))
            for degree in (2, 3):
                terms = [(a - b, b) for a in range(1, degree + 1) for b in range(a + 1)]
                columns = np.column_stack([p[:, a] * q[:, b] for a, b in terms])
                shapes.append((f"smooth in {names[i]} and {names[j]}, degree {degree}", columns))

    since, best, refits = time.process_time(), (0.0, ""), 0
    for d, letter in enumerate("xyz"):
        rows = slice(d * count, (d + 1) * count)
        chi2 = np.sum(left[rows] ** 2)
        degrees = count - np.sum(hat[rows] ** 2)
        for name, columns in shapes:
            design = np.zeros((3 * count, 6 + columns.shape[1]))
            design[:, :6] = weighted
            design[rows, 6:] = columns * weights[rows, None]
            solved = lstsq(design, target, lapack_driver="gelsy", check_finite=False)[0]
            reduction = np.sum(left**2) - np.sum((target - design @ solved) ** 2)
            more = columns.shape[1]
            statistic = reduction / more / ((chi2 - reduction) / (degrees - more))
            log_p = fisher.logsf(statistic, more, degrees - more) / np.log(10)
            best = min(best, (log_p, f"{name}, component {letter}"))
            refits += 1
    seconds = time.process_time() - since

    since, again = time.process_time(), (0.0, "")
    for d, letter in enumerate("xyz"):
        rows = slice(d * count, (d + 1) * count)
        own_hat, own_left = hat[rows], left[rows]
        chi2, degrees = np.sum(own_left**2), count - np.sum(own_hat**2)
        for name, columns in shapes:
            own = columns * weights[rows, None]
            taken, gradient = own_hat.T @ own, own.T @ own_left
            reduction = gradient @ np.linalg.solve(own.T @ own - taken.T @ taken, gradient)
            more = columns.shape[1]
            statistic = reduction / more / ((chi2 - reduction) / (degrees - more))
            log_p = fisher.logsf(statistic, more, degrees - more) / np.log(10)
            again = min(again, (log_p, f"{name}, component {letter}"))
    by_hand = time.process_time() - since
    assert again[1] == best[1] and abs(again[0] / best[0] - 1) < 1e-6, (again, best)
    print(best[1], best[0], refits, seconds, by_hand, sep="\t")


main()
