//! Vectors and small rotations as plain arrays.

pub(crate) type Vector = [f64; 3];

pub(crate) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn times(a: Vector, factor: f64) -> Vector {
    a.map(|v| v * factor)
}

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// `p` turned by a rotation vector (Rodrigues 1840).
pub(crate) fn turned(p: Vector, by: Vector) -> Vector {
    let angle = length(by);
    if angle == 0.0 {
        return p;
    }
    let axis = times(by, 1.0 / angle);
    let along = times(axis, dot(axis, p) * (1.0 - angle.cos()));
    add(add(times(p, angle.cos()), times(cross(axis, p), angle.sin())), along)
}
