//! The probe's pose against the exact model, and the plans that do not determine it.

use super::*;

fn truth(a_deg: f64, c_deg: f64, distance_m: f64) -> SphereCentre {
    let (a_rad, c_rad) = (a_deg.to_radians(), c_deg.to_radians());
    let head = head_in_machine(a_rad, c_rad) * (direction() * distance_m + zero_m());
    let offset_m = c_in_machine(c_rad) * Vector3::new(0.0, OFFSET_M, 0.0);
    let centre = sphere_m() - head - offset_m;
    SphereCentre { a_rad, c_rad, distance_m, centre_m: centre.into(), u_m: None }
}

const OFFSET_M: f64 = -0.1e-3;
const SCALE: f64 = 0.9993;
const PLAN: [[f64; 2]; 6] = [[0.0, 0.0], [60.0, 45.0], [60.0, -45.0], [-60.0, 45.0], [-60.0, -45.0], [30.0, 100.0]];

fn direction() -> Vector3<f64> {
    Vector3::new(0.001, 0.018, -0.9998).normalize() * SCALE
}

fn zero_m() -> Vector3<f64> {
    Vector3::new(-0.011, 0.033, -0.4527)
}

fn sphere_m() -> Vector3<f64> {
    Vector3::new(-0.3987, -0.3406, -0.8647)
}

fn measured(plan: &[[f64; 2]], distances_m: &[f64]) -> Vec<SphereCentre> {
    plan.iter().flat_map(|[a, c]| distances_m.iter().map(|d| truth(*a, *c, *d))).collect()
}

const WITH_OFFSET: ProbePoseModel = ProbePoseModel { beam: BeamLength::Free, axis_offset: true };

#[test]
fn exact_centres_give_back_the_pose() {
    let pose = ProbePose::fit(&measured(&PLAN, &[0.09, 0.1]), WITH_OFFSET).unwrap();
    assert!((pose.centre_m - sphere_m()).norm() < 1e-13 && (pose.zero_m - zero_m()).norm() < 1e-12);
    assert!((pose.direction - direction()).norm() < 1e-12 && pose.rms_m() < 1e-14);
    assert!((pose.axis_offset_m.unwrap() - OFFSET_M).abs() < 1e-13);
    for centre in measured(&[[12.0, -70.0], [80.0, 170.0]], &[0.05, 0.2]) {
        assert!((pose.seen_m(&centre) - sphere_m()).norm() < 1e-12);
    }
}

/// With a true scale of one, both ways give the same; with another, only the free length finds it.
#[test]
fn a_beam_of_length_one_is_held_to_it() {
    let centres = measured(&PLAN, &[0.09, 0.1]);
    let model = ProbePoseModel { beam: BeamLength::One, axis_offset: true };
    let one = ProbePose::fit(&centres, model).unwrap();
    assert!((one.direction.norm() - 1.0).abs() < 1e-15 && one.degrees_of_freedom == 36 - 9);
    assert!(one.rms_m() > 1e-6, "the scale of the reading stays in the residuals");
    assert!(one.u_beam_length().unwrap() < 1e-16);
    // Moving along the constraint raises the residuals: gradient across the beam is zero.
    let sum = |step: Vector3<f64>| {
        let mut pose = one.clone();
        pose.direction = (pose.direction + step).normalize();
        let seen = |c: &SphereCentre| (pose.seen_m(c) - pose.centre_m).norm_squared();
        centres.iter().map(seen).sum::<f64>()
    };
    for d in 0..3 {
        let slope = (sum(Vector3::ith(d, 1e-6)) - sum(Vector3::ith(d, -1e-6))) / 2e-6;
        assert!(slope.abs() < 1e-12, "{slope}");
    }
    let true_scale: Vec<SphereCentre> =
        centres.iter().map(|c| SphereCentre { distance_m: c.distance_m * SCALE, ..*c }).collect();
    let [free, one] = [WITH_OFFSET, model].map(|model| ProbePose::fit(&true_scale, model).unwrap());
    assert!((free.direction - one.direction).norm() < 1e-11 && (free.zero_m - one.zero_m).norm() < 1e-11);
}

/// What each plan leaves open, by counting: a turn about one axis leaves the zero along it, one pose all of it, one distance
/// the three components of the beam.
#[test]
fn plans_that_do_not_determine_the_pose_say_what_is_open() {
    let two = [0.09, 0.1];
    // Plan, distances (m), rank, what stays open, why.
    type Case<'a> = (&'a [[f64; 2]], &'a [f64], usize, &'a str, &'a str);
    let cases: [Case; 6] = [
        (&PLAN[..1], &two, 6, "S0, T_p", "one pose"),
        (&PLAN, &two[..1], 6, "R_p, T_p", "one distance"),
        (&[[0.0, 0.0], [0.0, 50.0], [0.0, 120.0]], &two, 8, "S0, T_p", "one axis"),
        (&[[35.0, 0.0], [35.0, 50.0], [35.0, 120.0]], &two, 8, "S0, T_p", "one axis"),
        (&[[0.0, 20.0], [50.0, 20.0], [-40.0, 20.0]], &two, 8, "S0, T_p", "one axis"),
        (&PLAN[..2], &two, 8, "S0, T_p", "one axis"),
    ];
    for (plan, distances_m, rank, open, because) in cases {
        let ProbePoseError::Undetermined(found) =
            ProbePose::fit(&measured(plan, distances_m), ProbePoseModel::NINE).unwrap_err()
        else {
            panic!("{because}")
        };
        assert_eq!((found.rank, found.unknowns, found.open.join(", ").as_str()), (rank, 9, open), "{because}");
        assert!(found.to_string().contains(because) && found.to_string().contains("measure") || because == "one pose");
    }
    // Three poses and two distances are the least; the offset of the axes needs no more.
    for model in [ProbePoseModel::NINE, WITH_OFFSET] {
        assert!(ProbePose::fit(&measured(&PLAN[..3], &two), model).is_ok());
    }
    let message = ProbePose::fit(&[], ProbePoseModel::NINE).unwrap_err().to_string();
    assert!(message.contains("no centre") && message.contains("three poses"), "{message}");
}

#[test]
fn bad_centres_are_refused_with_a_remedy() {
    let centres = measured(&PLAN, &[0.09, 0.1]);
    let refused = |change: &dyn Fn(&mut Vec<SphereCentre>), says: &str| {
        let mut changed = centres.clone();
        change(&mut changed);
        let message = ProbePose::fit(&changed, ProbePoseModel::NINE).unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
    };
    refused(&|c| c[3].centre_m[2] = f64::NAN, "centre 4");
    refused(&|c| c[3].a_rad = f64::INFINITY, "centre 4");
    refused(&|c| c[2].u_m = Some(0.0), "centre 3");
    refused(&|c| c[9] = c[1], "centres 2 and 10");
    refused(&|c| c.iter_mut().for_each(|c| c.distance_m *= 1e3), "unit");
    for (a, c, axis) in [(-1.0, 1.0, "with A turned"), (1.0, -1.0, "with C turned"), (-1.0, -1.0, "with A and C")] {
        let turn = move |list: &mut Vec<SphereCentre>| {
            list.iter_mut().for_each(|centre| (centre.a_rad, centre.c_rad) = (a * centre.a_rad, c * centre.c_rad));
        };
        // Not symmetric about zero, or another sense would only exchange S0 and T_p.
        refused(&turn, axis);
    }
    let exchange: fn(&mut Vec<SphereCentre>) =
        |list| list.iter_mut().for_each(|centre| (centre.a_rad, centre.c_rad) = (centre.c_rad, centre.a_rad));
    refused(&exchange, "with A and C exchanged");
    let radians: fn(&mut Vec<SphereCentre>) =
        |list| list.iter_mut().for_each(|c| (c.a_rad, c.c_rad) = (c.a_rad.to_radians(), c.c_rad.to_radians()));
    refused(&radians, "radians");
    refused(&|list| list.iter_mut().for_each(|c| c.centre_m.swap(0, 2)), "x_mm and z_mm exchanged");
    let moved: fn(&mut Vec<SphereCentre>) =
        |list| list.iter_mut().enumerate().for_each(|(k, c)| c.centre_m[k % 3] += 0.05 * (k as f64).sin());
    refused(&moved, "no head is that bad");
}

/// Deterministic noise of unit variance.
fn noise(seed: usize, k: usize) -> f64 {
    let mut state = ((seed as u64) << 32 | k as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    for _ in 0..3 {
        state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        state ^= state >> 27;
    }
    12f64.sqrt() * ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
}

/// Every pose has an error of its own beside the scatter of its centres, as real heads have; twelve poses, two distances.
#[test]
fn the_covariance_holds_what_it_says_also_with_errors_of_the_poses() {
    let plan: Vec<[f64; 2]> =
        (0..12).map(|k| [[-60.0, -20.0, 25.0, 65.0][k % 4], [-80.0, 10.0, 95.0][k / 4]]).collect();
    let (within_m, between_m) = (5e-6, 100e-6);
    let (mut total, runs) = (0.0, 300);
    for seed in 0..runs {
        let mut centres = measured(&plan, &[0.09, 0.1]);
        for (k, centre) in centres.iter_mut().enumerate() {
            for d in 0..3 {
                centre.centre_m[d] +=
                    between_m * noise(seed, 3 * (k / 2) + d) + within_m * noise(seed, 1000 + 3 * k + d);
            }
        }
        let pose = ProbePose::fit(&centres, WITH_OFFSET).unwrap();
        let u = pose.u().unwrap();
        let off = [pose.direction.x - direction().x, pose.zero_m.z - zero_m().z, pose.centre_m.y - sphere_m().y];
        let scaled = [off[0] / u[3], off[1] / u[8], off[2] / u[1]];
        total += scaled.iter().map(|z| z * z).sum::<f64>() / 3.0;
    }
    // z² with about 26 degrees of freedom has mean 26/24; 900 of them scatter by √(2/900) = 0.05, and are not independent.
    let mean = total / runs as f64;
    assert!((0.85..1.35).contains(&mean), "{mean}");
}

/// Centres as uncertain as they say, some ten times more than others: a mean of them judged all by the worst, and told of a noise
/// declared far too large.
#[test]
fn regress_uneven_uncertainties_are_judged_each_by_its_own() {
    let plan: Vec<[f64; 2]> = (0..30).map(|k| [-70.0 + 4.6 * k as f64, 37.0 * k as f64]).collect();
    let mut centres = measured(&plan, &[0.09, 0.1]);
    for (k, centre) in centres.iter_mut().enumerate() {
        let u_m = if k % 4 < 2 { 1e-6 } else { 10e-6 };
        centre.u_m = Some(u_m);
        (0..3).for_each(|d| centre.centre_m[d] += u_m * noise(7, 3 * k + d));
    }
    let scatter = ProbePose::fit(&centres, WITH_OFFSET).unwrap().scatter;
    let (within, degrees) = scatter.chi2_per_dof_within.unwrap();
    // About 87 degrees of freedom, even noise: sd √(0.8/87) = 0.1; four of them.
    assert!((80..90).contains(&degrees) && (within - 1.0).abs() < 0.4, "{within} {degrees}");
    assert!((scatter.chi2_per_dof.unwrap() / within - 1.0).abs() < 0.3, "{scatter:?}");
}

/// With few poses the noise is known from few degrees of freedom, and u has Student's factor.
#[test]
fn few_poses_state_what_they_hold() {
    let plan: Vec<[f64; 2]> = vec![[-60.0, -80.0], [-20.0, 10.0], [25.0, 95.0], [65.0, -20.0]];
    let (mut held, mut bare, mut all) = (0, 0, 0);
    for seed in 0..300 {
        let mut centres = measured(&plan, &[0.09, 0.1]);
        for (k, centre) in centres.iter_mut().enumerate() {
            // Sums of twelve even numbers are normal enough.
            let normal = |d: usize| (0..12).map(|i| noise(seed, 100 * k + 12 * d + i)).sum::<f64>() / 12f64.sqrt();
            (0..3).for_each(|d| centre.centre_m[d] += 5e-6 * normal(d));
        }
        let pose = ProbePose::fit(&centres, ProbePoseModel { beam: BeamLength::Free, axis_offset: true }).unwrap();
        let (u, widening) = (pose.u().unwrap(), pose.claim.unwrap().widening);
        let off = [pose.direction.x - direction().x, pose.zero_m.z - zero_m().z, pose.centre_m.y - sphere_m().y];
        for (off, u) in off.iter().zip([u[3], u[8], u[1]]) {
            held += usize::from(off.abs() <= 2.0 * u);
            bare += usize::from(off.abs() <= 2.0 * u / widening);
            all += 1;
        }
    }
    let share = |count: usize| count as f64 / f64::from(all);
    println!("four poses: {:.3}, without widening {:.3}", share(held), share(bare));
    assert!(share(held) >= 0.93, "{} {}", share(held), share(bare));
}

#[test]
fn components_of_variance_are_found() {
    let plan: Vec<[f64; 2]> = (0..60).map(|k| [-70.0 + 2.3 * k as f64, 37.0 * k as f64]).collect();
    let mut centres = measured(&plan, &[0.08, 0.09, 0.1]);
    for (k, centre) in centres.iter_mut().enumerate() {
        (0..3)
            .for_each(|d| centre.centre_m[d] += 80e-6 * noise(5, 3 * (k / 3) + d) + 10e-6 * noise(5, 9000 + 3 * k + d));
    }
    let scatter = ProbePose::fit(&centres, WITH_OFFSET).unwrap().scatter;
    // 357 and 170 degrees of freedom: relative sd 1/√(2·357) = 4 % and 5 %; four of them.
    assert!((scatter.within_m.unwrap() / 10e-6 - 1.0).abs() < 0.16, "{scatter:?}");
    assert!((scatter.between_m.unwrap() / 80e-6 - 1.0).abs() < 0.22, "{scatter:?}");
    assert_eq!(scatter.chi2_per_dof, None);
    centres.iter_mut().for_each(|centre| centre.u_m = Some(80e-6));
    let declared = ProbePose::fit(&centres, WITH_OFFSET).unwrap();
    assert!((0.7..1.3).contains(&declared.scatter.chi2_per_dof.unwrap()));
    assert!((declared.scatter.between_m.unwrap() / scatter.between_m.unwrap() - 1.0).abs() < 1e-9);
}

#[test]
fn the_table_returns_its_entries_interpolates_between_and_is_silent_outside() {
    let centres = measured(&PLAN, &[0.09, 0.1]);
    let mut pose = ProbePose::fit(&centres, WITH_OFFSET).unwrap();
    let shift = Vector3::new(1e-3, -2e-3, 3e-3);
    pose.centre_m += shift;
    let table = CompensationTable::new(&pose, &centres);
    assert_eq!(table.entries.len(), 6);
    for entry in &table.entries {
        assert!((entry.delta_m - shift).norm() < 1e-12 && entry.centres == 2 && entry.spread_m.unwrap() < 1e-12);
        assert_eq!(table.at(entry.a_rad, entry.c_rad), Compensation::Tabulated { delta_m: entry.delta_m });
    }
    let between = table.at(0.3, -0.2);
    assert!(
        matches!(between, Compensation::Interpolated { delta_m } if (delta_m - shift).norm() < 1e-12),
        "{between:?}"
    );
    for [a, c] in [[1.2, 0.0], [0.0, -1.0], [-1.1, 1.0], [0.9, 1.6]] {
        assert_eq!(table.at(a, c), Compensation::Outside, "{a} {c}");
    }
    // On the edge between two poses.
    assert!(table.at(60f64.to_radians(), 0.1).delta_m().is_some());
}

#[test]
fn a_pose_left_out_meets_the_error_that_no_other_pose_has() {
    let mut centres = measured(&PLAN, &[0.09, 0.1]);
    for k in [0, 1] {
        centres[k].centre_m[0] += 0.5e-3;
    }
    let poses = leave_one_pose_out(&centres, WITH_OFFSET).unwrap();
    assert!((poses[0].error_m.unwrap() + Vector3::x() * 0.5e-3).norm() < 1e-10, "{:?}", poses[0]);
    assert!(matches!(poses[0].compensation, Some(Compensation::Interpolated { .. })));
    assert!(poses[1..].iter().any(|pose| pose.compensation == Some(Compensation::Outside)));
    // Measured again in the same pose, the table takes most of it away: one centre less also turns the beam a little.
    let again = leave_one_centre_out(&centres, WITH_OFFSET).unwrap();
    for centre in again.iter().flatten() {
        assert!(centre.compensated_m.norm() < 1e-9 + 0.2 * centre.error_m.norm(), "{centre:?}");
    }
    assert!(leave_one_pose_out(&measured(&PLAN[..3], &[0.09, 0.1]), ProbePoseModel::NINE).is_err());
}

/// Angles as indicated, scattered by an arc second: every centre became a pose of its own, and what poses have in common noise of
/// single centres. U held 47 to 60 % where it said 95.
#[test]
fn regress_angles_as_indicated_stay_one_pose() {
    let (mut inside, mut all) = (0, 0);
    for seed in 0..200 {
        let mut centres = Vec::new();
        for (pose, [a, c]) in PLAN.iter().enumerate() {
            for (k, distance_m) in [0.085, 0.09, 0.095, 0.1, 0.105].into_iter().enumerate() {
                let place = 10 * pose + k;
                let jitter = |d: usize| 3e-4 * noise(seed, 5000 + 2 * place + d);
                let mut centre = truth(a + jitter(0), c + jitter(1), distance_m);
                for d in 0..3 {
                    centre.centre_m[d] += 10e-6 * noise(seed, 3 * pose + d) + 5e-6 * noise(seed, 1000 + 3 * place + d);
                }
                centres.push(centre);
            }
        }
        assert_eq!((poses(&centres).len(), near_poses(&centres).len()), (6, 0));
        let pose = ProbePose::fit(&centres, WITH_OFFSET).unwrap();
        let u = pose.u().unwrap();
        for (k, off) in (pose.centre_m - sphere_m()).iter().chain((pose.zero_m - zero_m()).iter()).enumerate() {
            let own = if k < 3 { u[k] } else { u[k + 3] };
            inside += i32::from(off.abs() < 2.0 * own);
            all += 1;
        }
        let table = CompensationTable::new(&pose, &centres);
        assert!(centres.iter().all(|c| matches!(table.at(c.a_rad, c.c_rad), Compensation::Tabulated { .. })));
    }
    let share = f64::from(inside) / f64::from(all);
    println!("held {share:.3}");
    // 200 fits of unknowns that go together: two standard deviations are 0.03.
    assert!((0.92..0.985).contains(&share), "{share}");
}

#[test]
fn poses_that_nearly_coincide_are_told_and_those_that_do_are_one() {
    let beside = |by_deg: f64| {
        let mut centres = measured(&PLAN, &[0.09, 0.1]);
        centres.push(truth(60.0 + by_deg, 45.0, 0.11));
        (poses(&centres).len(), near_poses(&centres))
    };
    assert_eq!(beside(0.005), (6, vec![]));
    assert_eq!(beside(0.05), (7, vec![[2, 12]]));
    assert_eq!(beside(0.5), (7, vec![]));
}

/// Centres with noise and an offset, three distances in each pose.
fn noisy(offset_m: f64, noise_m: f64, seed: usize) -> Vec<SphereCentre> {
    let mut centres = measured(&PLAN, &[0.09, 0.095, 0.1]);
    for (k, centre) in centres.iter_mut().enumerate() {
        let moved_m = c_in_machine(centre.c_rad) * Vector3::new(0.0, OFFSET_M - offset_m, 0.0);
        (0..3).for_each(|d| centre.centre_m[d] += moved_m[d] + noise_m * noise(seed, 10 * k + d));
    }
    centres
}

/// Left out, an offset of 0.8 mm puts the zero of the beam half a millimetre off, for half of the seeds beyond its U.
#[test]
fn regress_an_offset_of_the_axes_that_was_not_asked_for_is_told() {
    let (mut before, mut after) = (0, 0);
    for seed in 0..30 {
        let centres = noisy(0.8e-3, 10e-6, seed);
        let pose = ProbePose::fit(&centres, ProbePoseModel::NINE).unwrap();
        let told = pose.untold_offset(&centres).unwrap();
        assert!(told.is_certain && (told.offset_m - 0.8e-3).abs() < 4.0 * told.u_m.min(20e-6), "{seed}: {told:?}");
        let holds = |pose: &ProbePose| {
            let (off_m, u) = ((pose.zero_m - zero_m()).abs(), pose.u().unwrap());
            (0..3).all(|d| off_m[d] <= 2.0 * u[6 + d])
        };
        before += usize::from(holds(&pose));
        after += usize::from(holds(&pose.clone().widened_to(&told.with)));
        assert!(told.with.untold_offset(&centres).is_none());
    }
    assert!(before < 20 && after >= 28, "{before} {after}");
}

/// Of 400 heads without an offset 4 are told by chance (sd 2), and 0.04 refused. Poses that err each for itself are no offset.
#[test]
fn a_head_without_an_offset_is_not_given_one() {
    for of_pose_m in [0.0, 50e-6] {
        let told: Vec<_> = (0..400)
            .filter_map(|seed| {
                let mut centres = noisy(0.0, 10e-6, seed);
                let each = centres.len() / PLAN.len();
                for (k, centre) in centres.iter_mut().enumerate() {
                    (0..3).for_each(|d| centre.centre_m[d] += of_pose_m * noise(seed + 7000, 10 * (k / each) + d));
                }
                ProbePose::fit(&centres, ProbePoseModel::NINE).unwrap().untold_offset(&centres)
            })
            .collect();
        let certain = told.iter().filter(|told| told.is_certain).count();
        assert!(told.len() <= 12 && certain <= 1, "{} {certain}", told.len());
    }
    let exact = noisy(0.0, 0.0, 0);
    assert!(ProbePose::fit(&exact, ProbePoseModel::NINE).unwrap().untold_offset(&exact).is_none());
}
