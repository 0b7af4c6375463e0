//! Sphere centres as a study: rows, base columns, candidates, blocks.
//!
//! Place in the flow: between the exact chain and the common search. Residual = indicated centre less predicted, whitened.
//! Centres of one pose (other distances, repeats) share that pose's error, so an effect of the pose is tested against the
//! scatter between poses: the search sees their weighted mean, three rows a pose, as in the analysis of a split plot
//! (Montgomery, Design and Analysis of Experiments, chapter 14). The nine unknowns come from all centres, and are at their
//! best for the flaws at every point of linearisation.

use super::SphereCentre;
use super::chain::{Acts, Flaws, Pose, point};
use super::effects::{Known, REGISTRY};
use crate::error::DiagnoseError;
use crate::linear::Linear;
use crate::score::{Score, score_of};
use crate::study::candidate::{Candidate, Goes, Local, Study};
use crate::study::outcome::Untestable;
use abbe_geometry::Vector3;
use abbe_geometry::effects::ParameterSpec;
use abbe_measurement::probe_pose::{self, ProbePose, ProbePoseModel};
use faer::Mat;

/// Assumed where no uncertainty is declared (m); only ratios matter then.
const ASSUMED_M: f64 = 1e-6;
const FEWEST_POSES: usize = 4;

/// All that is measured.
pub(super) struct Spheres {
    poses: Vec<Pose>,
    sigma_m: Vec<f64>,
    is_declared: bool,
    /// Centres of each pose.
    groups: Vec<Vec<usize>>,
    /// Rows of each pose.
    blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
    /// Effect and parameters of each candidate.
    parts: Vec<(&'static Known, &'static [usize])>,
}

impl Spheres {
    pub(super) fn new(centres: &[SphereCentre]) -> Result<Spheres, DiagnoseError> {
        ProbePose::fit(centres, ProbePoseModel::NINE)?;
        let pose = |c: &SphereCentre| Pose {
            a_rad: c.a_rad,
            c_rad: c.c_rad,
            distance_m: c.distance_m,
            reading_m: Vector3::from(c.centre_m),
        };
        let is_declared = centres.iter().all(|centre| centre.u_m.is_some());
        let sigma = |c: &SphereCentre| if is_declared { c.u_m.unwrap_or(ASSUMED_M) } else { ASSUMED_M };
        let poses: Vec<Pose> = centres.iter().map(pose).collect();
        let groups = probe_pose::poses(centres);
        if groups.len() < FEWEST_POSES {
            return Err(DiagnoseError::Data {
                problem: format!(
                    "the centres come from {} poses of A and C, at least {FEWEST_POSES} are needed",
                    groups.len()
                ),
                remedy: "measure the sphere at further angles".to_owned(),
            });
        }
        let blocks = (0..groups.len()).map(|k| vec![3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let parts: Vec<(&'static Known, &'static [usize])> =
            REGISTRY.iter().flat_map(|known| known.groups.iter().map(move |group| (known, *group))).collect();
        let candidates = parts.iter().map(|(known, group)| candidate(known, group)).collect();
        let sigma_m = centres.iter().map(sigma).collect();
        Ok(Spheres { poses, sigma_m, is_declared, groups, blocks, candidates, parts })
    }

    fn flaws(&self, pose: &Pose, added: &[(usize, Vec<f64>)]) -> Flaws {
        let mut flaws = [0.0; Acts::COUNT];
        for (candidate, values) in added {
            let (known, group) = self.parts[*candidate];
            (known.motion)(pose, &mut |k, acts, amount| {
                if let Some(at) = group.iter().position(|member| *member == k) {
                    flaws[acts.index()] += amount * values[at];
                }
            });
        }
        flaws
    }

    /// Columns of S0, R_p, T_p, and what remains to be explained by them (whitened).
    fn base(&self, added: &[(usize, Vec<f64>)]) -> (Mat<f64>, Vec<f64>) {
        let rows = 3 * self.poses.len();
        let (mut columns, mut observed) = (Mat::zeros(rows, 9), vec![0.0; rows]);
        for (i, pose) in self.poses.iter().enumerate() {
            let at = point(pose, &self.flaws(pose, added), &Vector3::zeros(), &Vector3::zeros());
            let own = probe_pose::centre_rows(&at.turn, at.distance_m);
            for d in 0..3 {
                let weight = 1.0 / self.sigma_m[i];
                observed[3 * i + d] = (pose.reading_m[d] + at.constant_m[d]) * weight;
                (0..9).for_each(|k| columns[(3 * i + d, k)] = own[(d, k)] * weight);
            }
        }
        (columns, observed)
    }

    /// The nine unknowns at their best for these flaws.
    fn base_fit(&self, added: &[(usize, Vec<f64>)]) -> Result<(Vec<f64>, Linear), DiagnoseError> {
        let (columns, observed) = self.base(added);
        let (linear, unknowns) = Linear::least_squares(columns, &observed)?;
        Ok((unknowns, linear))
    }

    /// Weighted means over the centres of each pose of whitened rows, whitened again.
    fn means(&self, row: impl Fn(usize) -> f64, axis: usize) -> impl Iterator<Item = f64> {
        let sigma_m = &self.sigma_m;
        self.groups.iter().map(move |group| {
            let weight: f64 = group.iter().map(|i| sigma_m[*i].powi(-2)).sum();
            group.iter().map(|i| row(3 * i + axis) / sigma_m[*i]).sum::<f64>() / weight.sqrt()
        })
    }

    fn mean_columns(&self, columns: &Mat<f64>) -> Mat<f64> {
        let mut means = Mat::zeros(3 * self.groups.len(), columns.ncols());
        for j in 0..columns.ncols() {
            for d in 0..3 {
                for (k, mean) in self.means(|row| columns[(row, j)], d).enumerate() {
                    means[(3 * k + d, j)] = mean;
                }
            }
        }
        means
    }
}

impl Study for Spheres {
    fn of(&self) -> &'static str {
        "sphere centres of a five-axis machine"
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    /// The point is the nine unknowns and then the flaws of every pose.
    fn local(&self, added: &[(usize, Vec<f64>)]) -> Result<Local, DiagnoseError> {
        let (mut point, linear) = self.base_fit(added)?;
        for pose in &self.poses {
            point.extend(self.flaws(pose, added));
        }
        let residuals = linear.residuals();
        let mut residual = vec![0.0; 3 * self.groups.len()];
        for d in 0..3 {
            self.means(|row| residuals[row], d).enumerate().for_each(|(k, mean)| residual[3 * k + d] = mean);
        }
        Ok(Local { residual, base: self.mean_columns(&linear.jacobian().to_owned()), point })
    }

    fn columns(&self, at: &[f64], candidate: usize) -> Mat<f64> {
        let (known, group) = self.parts[candidate];
        let (unknowns, flaws) = at.split_at(9);
        let direction = Vector3::new(unknowns[3], unknowns[4], unknowns[5]);
        let zero_m = Vector3::new(unknowns[6], unknowns[7], unknowns[8]);
        let mut columns = Mat::zeros(3 * self.poses.len(), group.len());
        for (i, (pose, flaws)) in self.poses.iter().zip(flaws.chunks_exact(Acts::COUNT)).enumerate() {
            let own: Flaws = std::array::from_fn(|k| flaws[k]);
            let by_flaw = point(pose, &own, &direction, &zero_m).by_flaw;
            (known.motion)(pose, &mut |k, acts, amount| {
                if let Some(at) = group.iter().position(|member| *member == k) {
                    // The centre indicated moves against the point: Q = S0 − (q − Q).
                    let moved = by_flaw[acts.index()] * (-amount / self.sigma_m[i]);
                    (0..3).for_each(|d| columns[(3 * i + d, at)] += moved[d]);
                }
            });
        }
        self.mean_columns(&columns)
    }

    fn is_linear(&self) -> bool {
        false
    }

    fn blocks(&self) -> &[Vec<usize>] {
        &self.blocks
    }

    fn block_word(&self) -> &str {
        "pose (all centres at the same A and C)"
    }

    fn rows_per_point(&self) -> usize {
        3
    }

    fn unit_m(&self) -> f64 {
        let mean = self.sigma_m.iter().map(|s| s.powi(-2)).sum::<f64>() / self.groups.len() as f64;
        mean.sqrt().recip()
    }

    fn is_declared(&self) -> bool {
        self.is_declared
    }

    /// From all centres: do those of one pose agree better than the poses do?
    fn lack_of_fit(&self, added: &[(usize, Vec<f64>)]) -> Option<(String, Score)> {
        if self.groups.iter().all(|group| group.len() < 2) {
            return None;
        }
        let (_, linear) = self.base_fit(added).ok()?;
        let mut columns = Mat::zeros(3 * self.poses.len(), 3 * self.groups.len());
        for (k, group) in self.groups.iter().enumerate() {
            for i in group {
                (0..3).for_each(|d| columns[(3 * i + d, 3 * k + d)] = 1.0 / self.sigma_m[*i]);
            }
        }
        let score = score_of(&linear, columns.as_ref());
        Some(("centres at the same A and C".to_owned(), score))
    }

    fn base_word(&self) -> &'static str {
        "the base model (sphere centre, probe direction and probe zero)"
    }

    fn untestable(&self) -> Vec<Untestable> {
        Vec::new()
    }

    fn notes(&self) -> Vec<String> {
        vec![
            "The probe's direction is fitted with free length; that length is the scale of the distance reading.".into(),
            "Centres of one pose share that pose's error: effects are tested against the scatter between poses, and every \
             rms is that of the poses' means."
                .into(),
        ]
    }
}

fn candidate(known: &'static Known, group: &[usize]) -> Candidate {
    let unknown = |k: &usize| known.unknowns[*k];
    let name = match known.groups.len() {
        1 => known.name.to_owned(),
        _ => {
            let parts: Vec<&str> = group.iter().map(|k| unknown(k).name).collect();
            format!("{} {}", known.name, parts.join(" and ").replace('_', " "))
        }
    };
    let spec = |k: &usize| ParameterSpec::new(unknown(k).name, unknown(k).unit, unknown(k).plausible);
    Candidate {
        family: name.clone(),
        name,
        formula: format!("{}; typical {} ({})", known.formula, known.typical, known.source),
        kind: known.kind,
        covariates: Vec::new(),
        parameters: group.iter().map(spec).collect(),
        decided_by: known.decided_by.to_owned(),
        essential: Vec::new(),
        stands_apart: false,
        goes: Goes::ByEvidence,
    }
}
