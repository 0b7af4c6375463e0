//! Sphere centres, positioning runs and residual vectors are read in SI; what is wrong is named with its place and remedy.

use abbe_files::{
    read_component_vectors, read_plane_vectors, read_residual_vectors, read_runs, read_sphere_centres,
    read_sphere_centres_file,
};
use abbe_measurement::positioning::Approach;
use abbe_measurement::probe_pose::{ProbePose, ProbePoseModel};
use std::path::Path;

const CENTRES: &str = "a_deg,c_deg,d_mm,x_mm,y_mm,z_mm,u_um";
const RUNS: &str = "axis,target_mm,direction,cycle,measured_mm,time_s,temp_scale_x_c";
const VECTORS: &str = "x_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um,block,joint_1_deg";

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{message:?} does not say {part:?}");
    }
}

fn centres(lines: &[&str]) -> String {
    read_sphere_centres(lines.join("\n").as_bytes(), "c.csv").unwrap_err().to_string()
}

fn runs(lines: &[&str]) -> String {
    read_runs(lines.join("\n").as_bytes(), "r.csv").unwrap_err().to_string()
}

fn vectors(lines: &[&str]) -> String {
    read_residual_vectors(lines.join("\n").as_bytes(), "v.csv").unwrap_err().to_string()
}

/// Zhang 2016, recomputed: the file that is shipped is the table of the paper.
#[test]
fn val_zhang_2016_the_shipped_centres_give_the_sphere_of_plain_least_squares() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/data/zhang2016_centres.csv");
    let file = read_sphere_centres_file(&path).unwrap();
    assert_eq!(file.rows.len(), 10);
    let centre_mm = ProbePose::fit(&file.rows, ProbePoseModel::NINE).unwrap().centre_m * 1e3;
    for (found, expected) in centre_mm.iter().zip([-398.677719, -340.600360, -864.734832]) {
        assert!((found - expected).abs() < 2e-6, "{found} {expected}");
    }
}

#[test]
fn sphere_centres_are_read_in_si() {
    let text = format!("{CENTRES}\n90,-45,100,-1.5,2,3,15\n");
    let file = read_sphere_centres(text.as_bytes(), "c.csv").unwrap();
    let centre = file.rows[0];
    assert_eq!((centre.a_rad, centre.c_rad), (90f64.to_radians(), (-45f64).to_radians()));
    assert_eq!((centre.distance_m, centre.centre_m, centre.u_m), (0.1, [-1.5e-3, 2e-3, 3e-3], Some(15.0 / 1e6)));
}

#[test]
fn wrong_sphere_centres_are_refused() {
    assert_says(&centres(&[&CENTRES.replace("d_mm", "d_m"), "1"]), &["c.csv, line 1, column d_m", "millimetres"]);
    assert_says(&centres(&[&CENTRES.replace("c_deg,", ""), "1"]), &["column c_deg", "missing", "add the column"]);
    assert_says(&centres(&[&CENTRES.replace("u_um", "radius"), "1"]), &["column radius", "not known", "remove it"]);
    assert_says(&centres(&[CENTRES, "0,0,90,1,oops,3,15"]), &["line 2, column y_mm", "\"oops\" is not a number"]);
    assert_says(&centres(&[CENTRES, "0,0,90,1,2,3,0"]), &["line 2, column u_um", "not above zero", "k = 1"]);
    assert_says(&centres(&[CENTRES]), &["line 1", "header but no row", "one row"]);
}

#[test]
fn runs_are_read_in_si_with_what_was_logged() {
    let text = format!("{RUNS}\nX,100,+,1,100.0025,12.5,20.75\nX,100,down,1,100.001,,\n");
    let file = read_runs(text.as_bytes(), "r.csv").unwrap();
    let (first, second) = (&file.rows[0], &file.rows[1]);
    assert!((first.error_m() - 2.5e-6).abs() < 1e-15);
    assert_eq!((first.approach, second.approach), (Approach::Positive, Approach::Negative));
    assert_eq!((first.cycle, first.time_s, second.time_s), (1, Some(12.5), None));
    assert_eq!(first.covariates["temp_scale_x_c"], 20.75);
    assert!(second.covariates.is_empty());
}

#[test]
fn wrong_runs_are_refused() {
    assert_says(&runs(&[&RUNS.replace("measured_mm", "measured_um"), "1"]), &["column measured_um", "millimetres"]);
    assert_says(&runs(&[&RUNS.replace("target_mm", "targt_mm"), "1"]), &["did you mean it by targt_mm", "rename"]);
    // Errors instead of positions, and metres.
    assert_says(
        &runs(&[RUNS, "X,100,+,1,0.0025,1,20"]),
        &["line 2, column measured_mm", "off its target", "positions, not errors"],
    );
    assert_says(&runs(&[RUNS, "X,100,left,1,100,1,20"]), &["line 2, column direction", "\"left\"", "write +"]);
    assert_says(&runs(&[RUNS, "X,100,+,one,100,1,20"]), &["line 2, column cycle", "whole number", "1, 2, 3"]);
    assert_says(&runs(&[RUNS, "X,100,+,1,nan,1,20"]), &["line 2, column measured_mm", "not a finite number"]);
    assert_says(&runs(&[RUNS, "X,100,+,1,100,1,warm"]), &["column temp_scale_x_c", "\"warm\"", "remove the column"]);
}

#[test]
fn vectors_are_read_in_si_whatever_unit_their_names_say() {
    let text = format!("{VECTORS}\n100,200,300,1,-2,3,day 1,45\n");
    let millimetres = read_residual_vectors(text.as_bytes(), "v.csv").unwrap().rows.remove(0);
    assert_eq!((millimetres.position_m, millimetres.residual_m), ([0.1, 0.2, 0.3], [1e-6, -2.0 / 1e6, 3.0 / 1e6]));
    assert_eq!((millimetres.block.as_deref(), millimetres.covariates["joint_1_deg"]), (Some("day 1"), 45.0));
    let text = "x_m,y_m,z_m,res_x_mm,res_y_mm,res_z_mm,u_x_um,u_y_um,u_z_um\n0.1,0.2,0.3,0.001,-0.002,0.003,1,2,3\n";
    let metres = read_residual_vectors(text.as_bytes(), "v.csv").unwrap().rows.remove(0);
    assert_eq!(metres.position_m, millimetres.position_m);
    assert!((0..3).all(|d| (metres.residual_m[d] - millimetres.residual_m[d]).abs() < 1e-18));
    assert_eq!(metres.u_m, Some([1e-6, 2.0 / 1e6, 3.0 / 1e6]));
}

#[test]
fn wrong_vectors_are_refused() {
    assert_says(&vectors(&[&VECTORS.replace("res_", "rest_"), "1"]), &["column res_x_mm", "missing", "_um or _m"]);
    assert_says(
        &vectors(&[&VECTORS.replace("res_y_um", "res_y_mm"), "1"]),
        &["line 1, column res_", "is missing", "all three in one unit"],
    );
    assert_says(&vectors(&[VECTORS, "1,2,3,1,2,3,,45"]), &["line 2, column block", "name is empty"]);
    assert_says(&vectors(&[VECTORS, "1,2,3,1,2,,a,45"]), &["line 2, column res_z_um", "the cell is empty"]);
    assert_says(&vectors(&[VECTORS, "1,2,3"]), &["line 2", "3 cells", "header has 8"]);
}

#[test]
fn runs_may_hold_deviations_and_the_time_of_day() {
    let head = RUNS.replace("measured_mm", "deviation_um");
    let read = |rows: &str| read_runs(format!("{head}\n{rows}\n").as_bytes(), "r.csv");
    let file = read("X,100,+,1,2.5,2021-06-13T05:00:02,20.75\nX,100,-,1,-1,2021-06-13T05:01:02,21").unwrap();
    assert!((file.rows[0].error_m() - 2.5e-6).abs() < 1e-15 && (file.rows[1].error_m() + 1e-6).abs() < 1e-15);
    assert_eq!((file.rows[0].time_s, file.rows[1].time_s), (Some(0.0), Some(60.0)));
    let refused = read("X,100,+,1,100002.5,1,20").unwrap_err().to_string();
    assert_says(&refused, &["line 2, column deviation_um", "off its target", "not positions"]);
    let both = format!("{RUNS},deviation_um");
    assert_says(&runs(&[&both, "1"]), &["line 1, column deviation_um", "measured_mm", "remove one"]);
    assert_says(&runs(&[&RUNS.replace("measured_mm", "deviation_mm"), "1"]), &["column"]);
}

#[test]
fn regress_runs_with_millimetres_for_micrometres_are_refused() {
    let head = RUNS.replace("measured_mm", "deviation_um");
    let read = |rows: &str| read_runs(format!("{head}\n{rows}\n").as_bytes(), "r.csv");
    let told = read("X,100,+,1,0.0046,,\nX,200,+,1,-0.0123,,").unwrap_err().to_string();
    assert_says(&told, &["line 1, column deviation_um", "1.23e-2 µm", "multiply the numbers by 1000", "measured_mm"]);
    // Nothing but zeros has no unit, and whoever has so good a machine writes where it came to stand.
    assert!(read("X,100,+,1,0,,").is_ok());
    assert!(read_runs(format!("{RUNS}\nX,100,+,1,100.0000123,,\n").as_bytes(), "r.csv").is_ok());
}

#[test]
fn regress_vectors_that_abbe_wrote_are_read_back() {
    let text = format!("{VECTORS},status,res_status,res_extrapolated\n1,2,3,1,2,3,a,45,interpolated,in_volume,1\n");
    let file = read_residual_vectors(text.as_bytes(), "v.csv").unwrap();
    assert_eq!(file.rows[0].covariates.keys().collect::<Vec<_>>(), ["joint_1_deg"]);
}

#[test]
fn regress_a_quantity_in_two_units_is_no_covariate_of_itself() {
    let both = format!("{RUNS},deviation_mm");
    assert_says(
        &runs(&[&both, "X,100,+,1,100.004,1,20,0.004"]),
        &["column deviation_mm", "is deviation_um in another unit"],
    );
    let both = format!("{VECTORS},res_x_mm,res_y_mm,res_z_mm");
    let told = vectors(&[&both, "1,2,3,1,2,3,a,45,0.001,0.002,0.003"]);
    assert_says(&told, &["line 1, column res_x_um", "is res_x_mm in another unit", "keep one"]);
    assert_says(
        &vectors(&[&format!("{VECTORS},x_m"), "1,2,3,1,2,3,a,45,1"]),
        &["column x_m", "is x_mm in another unit"],
    );
}

#[test]
fn of_vectors_for_a_diagnosis_two_components_may_be_missing() {
    let of = |text: &str| read_component_vectors(text.as_bytes(), "v.csv").map(|file| file.rows[0].clone());
    let row = of("x_mm,y_mm,z_mm,res_z_um,u_z_um,temp_c\n100,200,300,4,0.5,20\n").unwrap();
    assert_eq!((row.residual_lacks, row.residual_m), ([true, true, false], [0.0, 0.0, 4e-6]));
    assert_eq!((row.u_m, row.covariates.len()), (Some([0.5e-6; 3]), 1));
    let error = |text: &str| of(text).unwrap_err().to_string();
    assert_says(&error("x_mm,y_mm,z_mm,temp_c\n1,2,3,20\n"), &["column res_x_mm", "is missing"]);
    assert_says(&error("x_mm,y_mm,z_mm,res_z_um,u_x_um\n1,2,3,4,1\n"), &["no z", "every residual"]);
    assert_says(&error("x_mm,y_mm,z_mm,res_z_um,rez_x_um\n1,2,3,4,1\n"), &["did you mean it by rez_x_um", "res_x_mm"]);
    // Who interpolates or trains wants to know where a vector points.
    let text = "x_mm,y_mm,z_mm,res_z_um\n1,2,3,4\n";
    assert_says(&vectors(&[text]), &["column res_x_um", "missing"]);
    assert_says(
        &read_plane_vectors(text.as_bytes(), "v.csv").unwrap_err().to_string(),
        &["column res_x_um", "missing"],
    );
}
