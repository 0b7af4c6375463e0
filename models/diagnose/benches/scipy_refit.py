"""Refits a linear model with each candidate effect added, in SciPy; prints the seconds of each way.

Place in the flow: rival of the score pass in `diagnose.rs`, which writes the file given as argument: doubles, sizes
first, then the whitened Jacobian, residuals and candidates (width, expected reduction of chi2 or -1, columns).
"""

import sys
import time

import numpy as np
import scipy.linalg


def read(path):
    data = np.fromfile(path)
    rows, parameters, candidates = (int(v) for v in data[:3])
    at = 3

    def take(columns):
        nonlocal at
        block = data[at : at + rows * columns].reshape(columns, rows).T
        at += rows * columns
        return block

    jacobian, residuals = take(parameters), take(1)[:, 0]
    groups = []
    for _ in range(candidates):
        width, expected = int(data[at]), data[at + 1]
        at += 2
        groups.append((take(width), expected))
    return jacobian, residuals, groups


def chi2_lstsq(columns, residuals):
    solution = scipy.linalg.lstsq(columns, residuals, lapack_driver="gelsy", check_finite=False)[0]
    return np.sum((residuals - columns @ solution) ** 2)


def chi2_normal(columns, residuals):
    scale = np.sqrt(np.sum(columns**2, axis=0))
    scaled = columns / scale
    normal = scaled.T @ scaled
    normal[np.diag_indices_from(normal)] += 1e-9
    factor = scipy.linalg.cho_factor(normal, check_finite=False)
    solution = scipy.linalg.cho_solve(factor, scaled.T @ residuals, check_finite=False)
    return np.sum((residuals - scaled @ solution) ** 2)


def main():
    jacobian, residuals, groups = read(sys.argv[1])
    for name, fit in [("scipy.linalg.lstsq refits", chi2_lstsq), ("NumPy normal-equation refits", chi2_normal)]:
        begin = time.perf_counter()
        base = fit(jacobian, residuals)
        reductions = [base - fit(np.hstack([jacobian, columns]), residuals) for columns, _ in groups]
        seconds = time.perf_counter() - begin
        for reduction, (_, expected) in zip(reductions, groups):
            if expected > 10.0 and abs(reduction / expected - 1.0) > 0.02:
                sys.exit(f"{name}: reduction {reduction} where the score pass has {expected}")
        print(f"{name} {seconds}")


if __name__ == "__main__":
    main()
