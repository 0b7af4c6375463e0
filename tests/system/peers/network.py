"""Multilateration by other hands: a machine of its own in NumPy, the same ranges solved by SciPy.

network.py make FOLDER SEED PLAN    writes campaign.csv, and truth.npz beside it
network.py judge FOLDER             reads vectors.csv, prints its rms error (µm) and what the stated u covers, as JSON
network.py rival FOLDER             the same beside the rms of SciPy's network, and of stations from nominal points

The machine is a Cartesian one with straightness, squareness, positioning and rolls, in its own sign and lever
conventions: only actual positions count. PLAN is `all` (every point from every station), `few` (half of the points from three
stations of six) or `outliers` (one reading in a hundred off by 20 µm to 2 mm).
"""

import csv
import json
import pathlib
import sys

import numpy as np
from scipy.optimize import least_squares

STATIONS_MM = np.array(
    [[-300, -300, -200], [1200, -200, -300], [1100, 1300, -100], [-200, 1200, -300], [400, -500, 1100], [1300, 500, 900]],
    dtype=float,
)
NOISE_UM = 0.3


def actual(p, rng):
    """Actual positions (mm) of indicated ones: bows, ripples, tilts of the guideways, scales."""
    t = p / np.array([800.0, 800.0, 450.0])
    bow = rng.uniform(-60e-3, 60e-3, (3, 3))
    ripple = rng.uniform(-4e-3, 4e-3, (3, 3))
    phase = rng.uniform(0, 6.28, (3, 3))
    e = np.zeros_like(p)
    for axis in range(3):
        for direction in range(3):
            s = t[:, axis]
            e[:, direction] += bow[axis, direction] * s * (1 - s) + ripple[axis, direction] * np.sin(7 * s + phase[axis, direction])
    e[:, 0] += rng.uniform(-40e-6, 40e-6) * p[:, 1] + rng.uniform(-40e-6, 40e-6) * p[:, 2]
    e[:, 1] += rng.uniform(-40e-6, 40e-6) * p[:, 2]
    e += p * rng.uniform(-20e-6, 20e-6, 3)
    return p + e


def make(folder, seed, plan):
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(np.linspace(0, 800, 6), np.linspace(0, 800, 6), np.linspace(0, 450, 4), indexing="ij")
    points = np.stack([g.ravel() for g in grid], axis=1)
    truth = actual(points, rng)
    dead = rng.uniform(100, 700, len(STATIONS_MM))
    rows, spoilt = [], []
    for k, station in enumerate(STATIONS_MM):
        for i, p in enumerate(points):
            if plan == "few" and i % 2 and (i // 2 + k) % 2:
                continue
            length = np.linalg.norm(truth[i] - station) - dead[k] + rng.normal() * NOISE_UM / 1e3
            spoilt.append(plan == "outliers" and rng.random() < 0.01)
            if spoilt[-1]:
                length += rng.choice([-1, 1]) * 10 ** rng.uniform(-1.7, 0.3)
            rows.append((k, i, length))
    with open(folder / "campaign.csv", "w", newline="") as f:
        out = csv.writer(f)
        out.writerow("station time_s x_mm y_mm z_mm offset_x_mm offset_y_mm offset_z_mm length_mm".split())
        for time, (k, i, length) in enumerate(rows):
            out.writerow([f"S{k}", time, *points[i], 0, 0, 0, f"{length:.9f}"])
    np.savez(folder / "truth.npz", points=points, truth=truth, rows=np.array(rows), spoilt=np.array(spoilt))


def fitted(moving, fixed):
    """Rigid motion of `moving` onto `fixed`."""
    a, b = moving.mean(0), fixed.mean(0)
    u, _, vt = np.linalg.svd((moving - a).T @ (fixed - b))
    d = np.diag([1, 1, np.sign(np.linalg.det(vt.T @ u.T))])
    r = vt.T @ d @ u.T
    return (moving - a) @ r.T + b


def rival(points, rows):
    """SciPy's least squares of everything from the nominal points, by MINPACK."""
    k, i, length = rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2]
    m, n = len(STATIONS_MM), len(points)
    starts = np.hstack([STATIONS_MM, np.zeros((m, 1))])
    for s in range(m):
        own = k == s
        starts[s, 3] = np.mean(np.linalg.norm(points[i[own]] - STATIONS_MM[s], axis=1) - length[own])
    place = np.arange(len(rows))

    def split(x):
        return x[: 4 * m].reshape(m, 4), x[4 * m :].reshape(n, 3)

    def residual(x):
        s, p = split(x)
        return (np.linalg.norm(p[i] - s[k, :3], axis=1) - s[k, 3] - length) * 1e3 / NOISE_UM

    def jacobian(x):
        s, p = split(x)
        ray = p[i] - s[k, :3]
        ray /= np.linalg.norm(ray, axis=1)[:, None]
        j = np.zeros((len(rows), 4 * m + 3 * n))
        for d in range(3):
            j[place, 4 * k + d] = -ray[:, d]
            j[place, 4 * m + 3 * i + d] = ray[:, d]
        j[place, 4 * k + 3] = -1
        return j * 1e3 / NOISE_UM

    x = np.concatenate([starts.ravel(), points.ravel()])
    return split(least_squares(residual, x, jacobian, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14).x)[1]


def nominal(points, rows):
    """The published two steps: each station from nominal points, then each point from the stations."""
    k, i, length = rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2]
    stations = []
    for s, start in enumerate(STATIONS_MM):
        own = k == s
        p, l = points[i[own]], length[own]
        f = lambda x: np.linalg.norm(p - x[:3], axis=1) - x[3] - l
        stations.append(least_squares(f, [*start, np.mean(np.linalg.norm(p - start, axis=1) - l)], xtol=1e-14, ftol=1e-14).x)
    stations = np.array(stations)
    found = np.empty_like(points)
    for n in range(len(points)):
        own = i == n
        s, l = stations[k[own]], length[own]
        f = lambda x: np.linalg.norm(x - s[:, :3], axis=1) - s[:, 3] - l
        found[n] = least_squares(f, points[n], xtol=1e-14, ftol=1e-14).x
    return found


def rms(e):
    return float(np.sqrt(np.mean(np.sum(e**2, axis=1))))


def judge(folder, with_rivals):
    data = np.load(folder / "truth.npz")
    points, truth, rows, spoilt = data["points"], data["truth"], data["rows"], data["spoilt"]
    with open(folder / "vectors.csv") as f:
        table = np.array([[float(v) for k, v in row.items() if k != "status"] for row in csv.DictReader(f)])
    index = np.array([np.argmin(np.linalg.norm(points - row[:3], axis=1)) for row in table])
    assert len(set(index)) == len(index)
    p, t = points[index], truth[index]
    # The stated frame: that in which these points fit best to where they were indicated.
    error_um = (table[:, :3] + table[:, 3:6] / 1e3 - fitted(t, p)) * 1e3
    said = {
        "points": len(index),
        "spoilt": int(spoilt.sum()),
        "rms_um": rms(error_um),
        "inside": int(np.sum(np.abs(error_um) < 1.959964 * table[:, 6:9])),
        "components": int(error_um.size),
        "u_um": rms(table[:, 6:9]),
    }
    if with_rivals:
        # They are told which readings are wrong.
        good = rows[~spoilt]
        other = rival(points, good)[index]
        said["scipy_rms_um"] = rms((fitted(other, t) - t) * 1e3)
        said["apart_um"] = rms((fitted(other, p) - table[:, :3]) * 1e3 - table[:, 3:6])
        said["two_steps_rms_um"] = rms((fitted(nominal(points, good)[index], t) - t) * 1e3)
    print(json.dumps(said))


if __name__ == "__main__":
    target = pathlib.Path(sys.argv[2])
    if sys.argv[1] == "make":
        make(target, int(sys.argv[3]), sys.argv[4])
    else:
        judge(target, sys.argv[1] == "rival")
