//! A moving bridge with a tracer on its table: which axis carries which, and what a range reads.

use crate::canvas::{BLUE, Canvas, GREEN, INK, MUTED, ORANGE, Point};
use crate::hold;

/// Oblique projection of a point in decimetres.
fn seen(x: f64, y: f64, z: f64) -> Point {
    (110.0 + 36.0 * x + 17.0 * y, 264.0 - 11.0 * y - 36.0 * z)
}

/// A box between two corners: top, front and right side.
fn solid(canvas: &mut Canvas, a: [f64; 3], b: [f64; 3], colour: &str) {
    let faces = [
        [(a[0], a[1], b[2]), (b[0], a[1], b[2]), (b[0], b[1], b[2]), (a[0], b[1], b[2])],
        [(a[0], a[1], a[2]), (b[0], a[1], a[2]), (b[0], a[1], b[2]), (a[0], a[1], b[2])],
        [(b[0], a[1], a[2]), (b[0], b[1], a[2]), (b[0], b[1], b[2]), (b[0], a[1], b[2])],
    ];
    for (face, opacity) in faces.into_iter().zip([0.12, 0.22, 0.32]) {
        let mut points: Vec<Point> = face.into_iter().map(|(x, y, z)| seen(x, y, z)).collect();
        canvas.area(&points, "#ffffff", 1.0);
        canvas.area(&points, colour, opacity);
        points.push(points[0]);
        canvas.path(&points, colour, 1.0, "");
    }
}

#[test]
fn the_chain_of_a_moving_bridge() {
    let mut canvas = Canvas::new(760.0, 310.0);
    solid(&mut canvas, [0.0, 0.0, -0.6], [8.0, 6.0, 0.0], MUTED);
    let station = seen(6.9, 1.2, 0.35);
    solid(&mut canvas, [2.4, 5.6, 0.0], [3.0, 6.0, 4.4], BLUE);
    solid(&mut canvas, [2.4, 0.0, 4.4], [3.0, 6.0, 5.0], BLUE);
    solid(&mut canvas, [2.4, 0.0, 0.0], [3.0, 0.4, 4.4], BLUE);
    solid(&mut canvas, [3.0, 2.6, 4.2], [3.5, 3.5, 5.2], ORANGE);
    solid(&mut canvas, [3.1, 2.9, 1.9], [3.4, 3.2, 5.7], GREEN);
    let tip = seen(3.25, 3.05, 1.2);
    canvas.path(&[seen(3.25, 3.05, 1.9), tip], INK, 1.5, "");
    canvas.path(&[station, tip], ORANGE, 1.5, "5 3");
    canvas.dot(tip, 4.5, ORANGE);
    canvas.dot(station, 7.0, INK);
    canvas.text((tip.0 - 8.0, tip.1 + 14.0), "end", INK, "q, the reflector");
    canvas.text((station.0 + 12.0, station.1 + 5.0), "start", INK, "S, the station");
    canvas.text(
        (0.5 * (station.0 + tip.0) + 12.0, 0.5 * (station.1 + tip.1) - 8.0),
        "start",
        ORANGE,
        "l + d = |q − S|",
    );
    let corner = (30.0, 270.0);
    for (end, name) in [((75.0, 270.0), "X"), ((57.0, 252.5), "Y"), ((30.0, 225.0), "Z")] {
        canvas.arrow(corner, end, INK);
        canvas.text((end.0 + 6.0, end.1 + 4.0), "start", INK, name);
    }
    let rows = [
        ("bed", MUTED, "the machine frame; stations stand here"),
        ("X, the bridge", BLUE, "EXX EYX EZX, EAX EBX ECX"),
        ("Y, the carriage", ORANGE, "EXY EYY EZY, EAY EBY ECY; C0Y"),
        ("Z, the ram", GREEN, "EXZ EYZ EZZ, EAZ EBZ ECZ; B0Z, A0Z"),
    ];
    for (k, (name, colour, words)) in rows.into_iter().enumerate() {
        let y = 40.0 + 40.0 * k as f64;
        canvas.text((450.0, y), "start", colour, name);
        canvas.text((450.0, y + 16.0), "start", MUTED, words);
    }
    hold("chain", &canvas.finished("A moving bridge: bed, X, Y and Z carry each other; a tracer on the table measures the distance to the reflector"));
}
