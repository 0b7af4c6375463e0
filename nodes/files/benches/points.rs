//! Time a row of what `abbe correct` does around the correction: reading, writing, both.
//!
//! Place in the flow: `cargo bench -p abbe-files --bench points`. The rival does the least that must be done: the `csv` crate
//! splits the rows, `str::parse` reads six numbers, `write!` writes six; no check, no hash, no dialect.

#![allow(missing_docs, clippy::unwrap_used)] // criterion's macros; a bench that cannot be prepared stops

use abbe_files::{PointRow, PointsReader, PointsWriter};
use abbe_geometry::correct::{Correction, Status};
use abbe_geometry::{Matrix3, Vector3};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::fmt::Write as _;
use std::hint::black_box;
use std::time::Duration;

const ROWS: usize = 20_000;
/// Rows that become text at once.
const CHUNK: usize = 512;

fn table() -> String {
    let mut text = "point,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,time_s,temp_air_c,note\n".to_owned();
    for k in 0..ROWS {
        let at = |factor: f64| 600.0 * (k as f64 * factor).fract();
        let (x, y, z) = (at(0.819_172_5), at(0.671_043_6), at(0.549_700_5));
        writeln!(text, "P{k},{x:.5},{y:.5},{z:.5},0.0,0.0,-60.125,{:.3},20.{k},probed", 0.125 * k as f64).unwrap();
    }
    text
}

fn corrected(row: &PointRow) -> Correction {
    let small = Vector3::new(1.234_567e-6, -2.345_678e-6, 3.456_789e-6);
    Correction {
        geometric_m: small,
        effects_m: Vector3::zeros(),
        position_m: Vector3::from(row.reading_m) + Vector3::from(row.offset_m) + small,
        covariance_m2: Some(Matrix3::identity() * 1.7e-13),
        status: Status::InVolume,
    }
}

fn read(text: &str) -> f64 {
    let mut reader = PointsReader::new(text.as_bytes(), "points.csv", None).unwrap();
    let (mut row, mut sum) = (PointRow::default(), 0.0);
    while reader.read(&mut row).unwrap() {
        sum += row.reading_m[0];
    }
    sum
}

fn through(text: &str) -> Vec<u8> {
    let mut reader = PointsReader::new(text.as_bytes(), "points.csv", None).unwrap();
    let mut writer = PointsWriter::new(Vec::with_capacity(2 * text.len()), "out.csv", &reader).unwrap();
    let mut rows = vec![PointRow::default(); CHUNK];
    loop {
        let mut read = 0;
        while read < CHUNK && reader.read(&mut rows[read]).unwrap() {
            read += 1;
        }
        if read == 0 {
            return writer.finish().unwrap();
        }
        let mut text = writer.form().text();
        rows[..read].iter().for_each(|row| text.push(row, &corrected(row)).unwrap());
        writer.append(&rows[..read], text).unwrap();
    }
}

fn least(text: &str) -> Vec<u8> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let mut writer = csv::Writer::from_writer(Vec::with_capacity(2 * text.len()));
    let (mut cells, mut number) = (csv::ByteRecord::new(), String::new());
    while reader.read_byte_record(&mut cells).unwrap() {
        let value = |k: usize| std::str::from_utf8(&cells[k]).unwrap().parse::<f64>().unwrap();
        let values = [1, 2, 3, 4, 5, 6].map(value);
        cells.iter().for_each(|cell| writer.write_field(cell).unwrap());
        for value in values {
            number.clear();
            write!(number, "{:.7}", value + 1.234_567e-3).unwrap();
            writer.write_field(&number).unwrap();
        }
        writer.write_field("in_volume").unwrap();
        writer.write_record(None::<&[u8]>).unwrap();
    }
    writer.into_inner().unwrap()
}

fn points(criterion: &mut Criterion) {
    let text = table();
    let mut group = criterion.benchmark_group("points");
    group.throughput(Throughput::Elements(ROWS as u64));
    group.bench_function("read", |bencher| bencher.iter(|| read(black_box(&text))));
    group.bench_function("read_and_write", |bencher| bencher.iter(|| through(black_box(&text))));
    group.bench_function("rival_read_and_write", |bencher| bencher.iter(|| least(black_box(&text))));
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(Duration::from_secs(3));
    targets = points
}
criterion_main!(benches);
