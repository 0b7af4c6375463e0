"""The rival of the benchmark: the same fields by SciPy.

Place in the flow: `benches/fields.rs` writes the data and runs this file on it. Input: a file with the number of measured
points, then one line each of x y z and the three components of the error (m), then lines x y z of targets. Output: one line a
method with its name, the median time in seconds (making the interpolant and evaluating all targets), and then the values at
the first targets. Reading the file and importing are not timed.

Methods: `RegularGridInterpolator` (linear, on the lattice that the points make), `griddata` (linear on Delaunay tetrahedra of
the points as a scatter), `RBFInterpolator` with thin plates and with cubics, degree 1, no smoothing.
"""

import statistics
import sys
import time

import numpy as np
from scipy.interpolate import RBFInterpolator, RegularGridInterpolator, griddata

REPEATS = 5
SHOWN = 50


def radial(kernel):
    return lambda points, errors, targets: RBFInterpolator(points, errors, kernel=kernel, degree=1)(targets)


def trilinear(points, errors, targets):
    axes = [np.unique(points[:, axis]) for axis in range(3)]
    # x varies fastest in the file, slowest in the array.
    order = np.lexsort((points[:, 2], points[:, 1], points[:, 0]))
    values = errors[order].reshape([len(axis) for axis in axes] + [3])
    return RegularGridInterpolator(axes, values, method="linear")(targets)


METHODS = {
    "trilinear": trilinear,
    "griddata": lambda points, errors, targets: griddata(points, errors, targets, method="linear"),
    "thin_plate": radial("thin_plate_spline"),
    "cubic": radial("cubic"),
}


def main():
    with open(sys.argv[1], encoding="ascii") as file:
        count = int(file.readline())
        rows = [[float(cell) for cell in line.split()] for line in file]
    data, targets = np.array(rows[:count]), np.array(rows[count:])
    points, errors = data[:, :3], data[:, 3:]
    for name, method in METHODS.items():
        times = []
        for _ in range(REPEATS):
            begin = time.perf_counter()
            values = method(points, errors, targets)
            times.append(time.perf_counter() - begin)
        shown = " ".join(f"{value:.17e}" for value in values[:SHOWN].ravel())
        print(name, f"{statistics.median(times):.6f}", shown)


if __name__ == "__main__":
    main()
