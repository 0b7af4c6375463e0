//! No bytes make a reader panic, and what was written is read again as it was.

#[path = "../fuzz/exercise.rs"]
mod exercise;

use crate::mangled::mangled;
use abbe_files::{
    ModelFile, PointRow, PointsReader, SeenTarget, machine_text, parse_machine, parse_plan_request, read_campaign,
    read_guideway, read_positions, read_sphere_centres,
};
use exercise::handed_through;
use proptest::collection::vec;
use proptest::prelude::*;

const BRIDGE: &str = include_str!("../../../launch-config/machines/bridge_xyz.toml");
const REQUEST: &str = include_str!("../../../launch-config/plans/bridge_xyz.toml");
const CAMPAIGN: &str = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,length_mm,load_kg\n\
                        S1,A,1,600,588,450,0,0,-60,0,1\nS1,A,2,600,574.1,450,0,0,-60,-8.4,\nS2,B,2,1,2,3,0,0,-60,0,2\n";
const EUROPEAN: &str =
    "\u{feff}sep=;\r\n# decimal=,\r\nstation;time_s;x_mm;y_mm;z_mm;length_mm\r\nS1;1;600,125;588;450,5;0;\r\n";
const POINTS: &str = "sep=;\r\n# decimal=,\r\n\"note\";x_mm;y_mm;z_mm\r\n\"#1\";1,5;-2;3,25\r\n\r\n#;\r\nsep=,;1,125;\"2\";0\r\n\"a\"\"b;\r\nc\";0;0,5;1\r\n";
const GUIDEWAY: &str = "position_mm,target,range_mm,azimuth_deg,elevation_deg\n0,P,2000,30,-10\n0,Q,2100,31,-9.5\n";

/// Puts every reader to the bytes; what they say does not matter here.
fn read_all(bytes: &[u8]) {
    let _ = read_campaign(bytes, "fuzz", None);
    let _ = read_campaign(bytes, "fuzz", Some([0.0; 3]));
    let _ = ModelFile::from_bytes(bytes, "fuzz");
    let _ = read_sphere_centres(bytes, "fuzz");
    if let Ok(file) = read_guideway(bytes, "fuzz") {
        let finite = |seen: &SeenTarget| match seen {
            SeenTarget::Reading(reading) => reading.point_m().iter().all(|v| v.is_finite()),
            SeenTarget::Point { point_m, .. } => point_m.iter().all(|v| v.is_finite()),
        };
        assert!(
            file.rows.iter().all(|row| row.position_m.is_finite() && finite(&row.seen)),
            "accepted rows are finite"
        );
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = parse_machine(text, "fuzz");
        let _ = parse_plan_request(text, "fuzz");
    }
    if let Ok(mut reader) = PointsReader::new(bytes, "fuzz", Some([0.0; 3])) {
        let mut row = PointRow::default();
        while let Ok(true) = reader.read(&mut row) {}
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn arbitrary_bytes_never_panic(bytes in vec(any::<u8>(), 0..400)) {
        read_all(&bytes);
    }

    #[test]
    fn mangled_files_never_panic(
        campaign in mangled(CAMPAIGN),
        machine in mangled(BRIDGE),
        guideway in mangled(GUIDEWAY),
        european in mangled(EUROPEAN),
        request in mangled(REQUEST),
    ) {
        read_all(&request);
        read_all(&campaign);
        read_all(&european);
        read_all(&zstd::encode_all(campaign.as_slice(), 1).unwrap());
        read_all(&guideway);
        read_all(&machine);
    }

    /// A table that is handed through reads back as the same points, whatever its dialect and its other columns.
    #[test]
    fn regress_what_is_handed_through_reads_back(bytes in mangled(POINTS)) {
        if let Some((points, through)) = handed_through(&bytes)
            && !points.is_empty()
        {
            let again = read_positions(through.as_slice(), "through");
            prop_assert_eq!(again.map_err(|error| error.to_string()), Ok(points), "{:?}", String::from_utf8_lossy(&through));
        }
    }

    /// Rows as a logger writes them, with seven decimals, come back as these numbers.
    #[test]
    fn campaigns_come_back(
        rows in vec((-1e3f64..1e3, -1e3f64..1e3, -1e3f64..1e3, -2e3f64..2e3, prop::option::of(-50f64..50.0)), 1..30),
        crlf: bool,
    ) {
        let end = if crlf { "\r\n" } else { "\n" };
        let mut text = format!("load_kg,station,time_s,length_mm,z_mm,y_mm,x_mm{end}");
        for (k, (x, y, z, length, load)) in rows.iter().enumerate() {
            let load = load.map_or(String::new(), |load| load.to_string());
            text += &format!("{load},S1,{k},{length},{z},{y},{x}{end}");
        }
        let file = read_campaign(text.as_bytes(), "c.csv", Some([0.0, 0.0, -0.06])).unwrap();
        prop_assert_eq!(file.campaign.readings.len(), rows.len());
        for (k, (reading, (x, y, z, length, load))) in file.campaign.readings.iter().zip(&rows).enumerate() {
            prop_assert_eq!(reading.reading_m, [x / 1e3, y / 1e3, z / 1e3]);
            prop_assert_eq!((reading.length_m, reading.time_s), (length / 1e3, k as f64));
            prop_assert_eq!(file.campaign.covariates[0].values[k], *load);
        }
    }

    /// The same rows in the dialects of Excel are the same numbers, or refused with both readings; never other numbers.
    #[test]
    fn campaigns_come_back_in_any_dialect(
        rows in vec((-1e3f64..1e3, 0usize..4), 1..6),
        delimiter in prop::sample::select(vec![';', '\t']),
        has_mark: bool,
    ) {
        let mut text = String::from(if has_mark { "\u{feff}" } else { "" });
        text += &"station;time_s;x_mm;y_mm;z_mm;length_mm\r\n".replace(';', &delimiter.to_string());
        let mut expected = Vec::new();
        for (k, (value, digits)) in rows.iter().enumerate() {
            let number = format!("{value:.digits$}");
            expected.push(number.parse::<f64>().unwrap() / 1e3);
            text += &format!("S1;{k};{number};0;0;1\r\n").replace('.', ",").replace(';', &delimiter.to_string());
        }
        match read_campaign(text.as_bytes(), "c.csv", Some([0.0; 3])) {
            Ok(file) => {
                let read: Vec<f64> = file.campaign.readings.iter().map(|reading| reading.reading_m[0]).collect();
                prop_assert_eq!(read, expected);
            }
            Err(error) => {
                prop_assert!(error.to_string().contains("with a comma between thousands"), "{}", error);
                let only_threes = rows.iter().all(|(value, digits)| [0, 3].contains(digits) && (value.abs() >= 1.0 || *digits == 0));
                prop_assert!(only_threes, "{}", text);
            }
        }
    }

    /// Readings of a tracker come back as these numbers, in either unit of the range.
    #[test]
    fn tracker_readings_come_back(
        rows in vec((-1e3f64..1e3, 1e-3f64..4e4, -360f64..360.0, -90f64..90.0), 1..30),
        metres: bool,
    ) {
        let unit = if metres { "m" } else { "mm" };
        let mut text = format!("elevation_deg,range_{unit},target,azimuth_deg,position_mm\n");
        for (k, (position, range, azimuth, elevation)) in rows.iter().enumerate() {
            text += &format!("{elevation},{range},T{k},{azimuth},{position}\n");
        }
        let file = read_guideway(text.as_bytes(), "g.csv").unwrap();
        prop_assert_eq!(file.rows.len(), rows.len());
        for (row, (position, range, azimuth, elevation)) in file.rows.iter().zip(&rows) {
            let SeenTarget::Reading(reading) = row.seen else { panic!("a reading") };
            prop_assert_eq!(row.position_m, position / 1e3);
            prop_assert_eq!(reading.range_m, if metres { *range } else { range / 1e3 });
            prop_assert_eq!([reading.azimuth_rad, reading.elevation_rad], [azimuth.to_radians(), elevation.to_radians()]);
        }
    }

    #[test]
    fn machines_come_back(
        ends_mm in vec((-1000i32..0, 1i32..3000), 3),
        repeatability_nm in vec(0i32..5000, 3),
        intervals in 1usize..40,
        degree in 1usize..=10,
        offset_tenths in prop::option::of(vec(-2000i32..2000, 3)),
    ) {
        let mut file = parse_machine(BRIDGE, "m").unwrap();
        for k in 0..3 {
            file.machine.stroke_m[k] = (f64::from(ends_mm[k].0) / 1e3, f64::from(ends_mm[k].1) / 1e3);
            file.machine.repeatability_m[k] = f64::from(repeatability_nm[k]) / 1e3 / 1e6;
        }
        file.machine.kinds[0] = Some(abbe_geometry::error_function::FunctionKind::BSpline { intervals });
        file.machine.kinds[4] = Some(abbe_geometry::error_function::FunctionKind::Polynomial { degree });
        file.machine.kinds[9] = None;
        file.machine.default_offset_m = offset_tenths.map(|t| [t[0], t[1], t[2]].map(|v| f64::from(v) / 10.0 / 1e3));
        let text = machine_text(&file).unwrap();
        prop_assert_eq!(parse_machine(&text, "m").unwrap(), file, "{}", text);
    }
}
