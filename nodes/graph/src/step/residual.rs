//! The residual node's step: adds what a residual field says, or passes the sample through.
//!
//! Place in the flow: after the geometric node, before the users of corrected coordinates. Wraps
//! [`abbe_geometry::correct::add_residual`] between the message types. A field is what one geometric model leaves, so it is
//! added only to samples that this model made; every other sample leaves as it came, and its `residual_model_sha256`
//! stays empty, which says that nothing was added. A sample in another frame than the machine's comes from the corrector of
//! another machine, and is not passed on as a corrected one. What a field asks for beside the position comes with the scale reading
//! of the sample; where it is missing or stale nothing is added, and the sample says so, with the covariance of what the field does.

use super::geometric::{SampleCovariates, wire_status};
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::correct::add_residual;
use abbe_geometry::effects::{CovariateSource, NoCovariates};
use abbe_geometry::residual_field::ResidualField;
use abbe_geometry::{Matrix3, Vector3};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Covariates, Sha256};
use std::sync::Arc;

/// Fields kept for samples of different geometric models: a new model and its field never come at the same instant.
const KEPT_FIELDS: usize = 3;

/// A residual field and the geometric model that it belongs to.
#[derive(Clone)]
pub struct OwnedField {
    /// The field.
    pub field: Arc<dyn ResidualField>,
    /// SHA-256 of the geometric model that leaves it.
    pub model_sha256: Sha256,
}

/// Adds the residual field that belongs to the model of each sample.
#[derive(Clone, Default)]
pub struct ResidualStep {
    /// One for each geometric model, the newest last.
    fields: Vec<OwnedField>,
    /// Machine frame; none where the samples come from a step of the same machine.
    frame_id: Option<String>,
    max_covariate_age_s: f64,
}

impl ResidualStep {
    /// A step with this field, or none, and the age (s) beyond which a covariate is stale.
    pub fn new(field: Option<OwnedField>, max_covariate_age_s: f64) -> ResidualStep {
        ResidualStep { fields: field.into_iter().collect(), frame_id: None, max_covariate_age_s }
    }

    /// From the next sample on, a covariate of more than this age (s) is stale.
    pub fn set_max_covariate_age_s(&mut self, max_covariate_age_s: f64) {
        self.max_covariate_age_s = max_covariate_age_s;
    }

    /// Whether a field asks for covariates of this sample.
    pub fn asks_of(&self, sample: &CorrectedCoordinates) -> bool {
        self.field_of(sample).is_some_and(|owned| !owned.field.covariates().is_empty())
    }

    fn field_of(&self, sample: &CorrectedCoordinates) -> Option<&OwnedField> {
        let of_model = self.fields.iter().rev().find(|owned| owned.model_sha256 == sample.model_sha256);
        of_model.filter(|_| sample.corrected_valid)
    }

    /// The same for samples that come over a topic: those of another frame than this are withheld.
    pub fn in_frame(self, frame_id: &str) -> ResidualStep {
        ResidualStep { frame_id: Some(frame_id.to_owned()), ..self }
    }

    /// Adds this field from the next sample on. It takes the place of the one for the same geometric model; those for
    /// other models stay for samples that they still make.
    pub fn put_in_use(&mut self, field: OwnedField) {
        self.fields.retain(|other| other.model_sha256 != field.model_sha256);
        self.fields.push(field);
        if self.fields.len() > KEPT_FIELDS {
            self.fields.remove(0);
        }
    }

    /// Hash of the newest field; [`Sha256::NONE`] without one.
    pub fn residual_sha256(&self) -> Sha256 {
        self.fields.last().map_or(Sha256::NONE, |newest| Sha256::from_bytes(newest.field.sha256()))
    }

    /// Geometric model that the newest field belongs to; [`Sha256::NONE`] without one.
    pub fn model_sha256(&self) -> Sha256 {
        self.fields.last().map_or(Sha256::NONE, |newest| newest.model_sha256)
    }

    /// The sample with the residual added; what is not valid, or of a model that no field belongs to, passes unchanged. Where
    /// the field gives no number or no covariance, the sample is rejected. `covariates` are those of its scale reading, where that is
    /// known.
    pub fn correct(&self, sample: &CorrectedCoordinates, covariates: Option<&Covariates>) -> CorrectedCoordinates {
        if self.frame_id.as_ref().is_some_and(|frame_id| sample.frame_id.as_str() != frame_id) {
            return sample.withheld(CorrectionStatus::OtherFrame);
        }
        let Some(OwnedField { field, .. }) = self.field_of(sample) else { return *sample };
        let logged = covariates.map(|table| SampleCovariates { table, max_age_s: self.max_covariate_age_s });
        let covariates = logged.as_ref().map_or(&NoCovariates as &dyn CovariateSource, |logged| logged);
        let mut position_m = Vector3::from(sample.corrected_m);
        let mut covariance_m2 = Matrix3::from_row_slice(&sample.covariance_m2);
        let Some(added) = add_residual(&mut position_m, &mut covariance_m2, field.as_ref(), covariates) else {
            return rejected(sample);
        };
        CorrectedCoordinates {
            residual_correction_m: added.residual_m().into(),
            corrected_m: position_m.into(),
            covariance_m2: std::array::from_fn(|k| covariance_m2[(k / 3, k % 3)]),
            residual_model_sha256: Sha256::from_bytes(field.sha256()),
            status: sample.status.worse_of(wire_status(added.status())),
            ..*sample
        }
    }
}

/// The sample as it was before any correction.
fn rejected(sample: &CorrectedCoordinates) -> CorrectedCoordinates {
    CorrectedCoordinates {
        geometric_correction_m: [0.0; 3],
        effect_correction_m: [0.0; 3],
        residual_correction_m: [0.0; 3],
        corrected_m: nominal_point_m(sample.reading_m, sample.offset_m).into(),
        covariance_m2: [0.0; 9],
        corrected_valid: false,
        status: CorrectionStatus::Rejected,
        ..*sample
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_geometry::effects::{CovariateProblem, known_covariate};
    use abbe_geometry::residual_field::ResidualPrediction;

    const MODEL: Sha256 = Sha256::from_bytes([1; 32]);
    const OTHER_MODEL: Sha256 = Sha256::from_bytes([2; 32]);

    struct Shift {
        inside: bool,
        sha256: [u8; 32],
    }

    impl ResidualField for Shift {
        fn predict(
            &self,
            _point_in_machine_m: &Vector3<f64>,
            _covariates: &dyn CovariateSource,
        ) -> Result<ResidualPrediction, CovariateProblem> {
            let residual_m = Vector3::new(1e-6, -2e-6, 3e-6);
            Ok(ResidualPrediction { residual_m, covariance_m2: Matrix3::identity() * 1e-14, inside: self.inside })
        }

        fn sha256(&self) -> [u8; 32] {
            self.sha256
        }
    }

    fn field(inside: bool, sha256: u8, model_sha256: Sha256) -> OwnedField {
        OwnedField { field: Arc::new(Shift { inside, sha256: [sha256; 32] }), model_sha256 }
    }

    fn sample(corrected_valid: bool, status: CorrectionStatus) -> CorrectedCoordinates {
        let mut sample = crate::step::GeometricStep::new(None, 1.0).correct(&abbe_msgs::ScaleReading::default());
        sample.corrected_valid = corrected_valid;
        sample.status = status;
        sample.model_sha256 = MODEL;
        sample
    }

    #[test]
    fn without_a_field_a_sample_leaves_as_it_came() {
        let sample = sample(true, CorrectionStatus::InVolume);
        assert_eq!(ResidualStep::default().correct(&sample, None), sample);
    }

    #[test]
    fn a_field_moves_the_point_widens_the_covariance_and_signs_with_its_hash() {
        let step = ResidualStep::new(Some(field(true, 7, MODEL)), 10.0);
        let out = step.correct(&sample(true, CorrectionStatus::InVolume), None);
        assert_eq!(out.corrected_m, [1e-6, -2e-6, 3e-6]);
        assert_eq!(out.residual_correction_m, [1e-6, -2e-6, 3e-6]);
        assert_eq!(out.covariance_m2[4], 1e-14);
        assert_eq!(out.residual_model_sha256.to_bytes(), [7; 32]);
        assert_eq!(out.status, CorrectionStatus::InVolume);
    }

    #[test]
    fn outside_the_field_is_extrapolated_and_a_worse_status_stays() {
        let step = ResidualStep::new(Some(field(false, 7, MODEL)), 10.0);
        assert_eq!(
            step.correct(&sample(true, CorrectionStatus::InVolume), None).status,
            CorrectionStatus::Extrapolated
        );
        assert_eq!(step.correct(&sample(true, CorrectionStatus::Stale), None).status, CorrectionStatus::Stale);
        let rejected = sample(false, CorrectionStatus::Rejected);
        assert_eq!(step.correct(&rejected, None), rejected);
    }

    /// A field that says this at every point.
    struct Says(ResidualPrediction);
    impl ResidualField for Says {
        fn predict(
            &self,
            _point_in_machine_m: &Vector3<f64>,
            _covariates: &dyn CovariateSource,
        ) -> Result<ResidualPrediction, CovariateProblem> {
            Ok(self.0)
        }

        fn sha256(&self) -> [u8; 32] {
            [7; 32]
        }
    }

    #[test]
    fn regress_what_a_field_gives_is_a_number_with_a_covariance_or_the_sample_is_rejected() {
        let good = ResidualPrediction {
            residual_m: Vector3::repeat(1e-6),
            covariance_m2: Matrix3::identity() * 1e-14,
            inside: true,
        };
        let of = |said| {
            let owned = OwnedField { field: Arc::new(Says(said)), model_sha256: MODEL };
            ResidualStep::new(Some(owned), 10.0).correct(&sample(true, CorrectionStatus::InVolume), None)
        };
        assert!(of(good).corrected_valid);
        let bad = [
            ResidualPrediction { residual_m: Vector3::new(0.0, f64::NAN, 0.0), ..good },
            ResidualPrediction { residual_m: Vector3::new(f64::INFINITY, 0.0, 0.0), ..good },
            ResidualPrediction { covariance_m2: Matrix3::repeat(f64::NAN), ..good },
            ResidualPrediction { covariance_m2: -good.covariance_m2, ..good },
            ResidualPrediction { covariance_m2: Matrix3::repeat(1e300) * 1e300, ..good },
        ];
        for said in bad {
            let out = of(said);
            assert_eq!((out.corrected_valid, out.status), (false, CorrectionStatus::Rejected), "{said:?}");
            let indicated_m: [f64; 3] = std::array::from_fn(|d| out.reading_m[d] + out.offset_m[d]);
            assert_eq!((out.corrected_m, out.covariance_m2), (indicated_m, [0.0; 9]));
            assert!(abbe_msgs::Message::validate(&out).is_ok());
        }
    }

    #[test]
    fn a_sample_of_another_model_passes_without_the_field_and_says_so() {
        let step = ResidualStep::new(Some(field(true, 7, OTHER_MODEL)), 10.0);
        let sample = sample(true, CorrectionStatus::InVolume);
        let out = step.correct(&sample, None);
        assert_eq!(out, sample);
        assert!(out.residual_model_sha256.is_none());
    }

    #[test]
    fn regress_a_corrected_sample_of_another_frame_is_withheld() {
        let step = ResidualStep::new(Some(field(true, 7, MODEL)), 10.0).in_frame("machine");
        for frame_id in ["", "other"] {
            let mut sample = sample(true, CorrectionStatus::InVolume);
            sample.frame_id = abbe_msgs::Text::new(frame_id).unwrap();
            let out = step.correct(&sample, None);
            assert_eq!((out.status, out.corrected_point_in_machine_m()), (CorrectionStatus::OtherFrame, None));
        }
        let mut own = sample(true, CorrectionStatus::InVolume);
        own.frame_id = abbe_msgs::Text::new("machine").unwrap();
        assert_eq!(step.correct(&own, None).status, CorrectionStatus::InVolume);
    }

    #[test]
    fn each_sample_gets_the_newest_field_of_its_own_model() {
        let mut step = ResidualStep::new(Some(field(true, 7, MODEL)), 10.0);
        step.put_in_use(field(true, 8, OTHER_MODEL));
        let old = sample(true, CorrectionStatus::InVolume);
        let new = CorrectedCoordinates { model_sha256: OTHER_MODEL, ..old };
        let hash = |step: &ResidualStep, sample| step.correct(sample, None).residual_model_sha256.to_bytes()[0];
        assert_eq!([hash(&step, &old), hash(&step, &new)], [7, 8]);
        step.put_in_use(field(true, 9, MODEL));
        assert_eq!([hash(&step, &old), hash(&step, &new)], [9, 8]);
        assert_eq!((step.model_sha256(), step.residual_sha256().to_bytes()), (MODEL, [9; 32]));
    }

    /// A field that follows the temperature: 1 µm a degree in x.
    struct Warm([String; 1]);
    impl ResidualField for Warm {
        fn covariates(&self) -> &[String] {
            &self.0
        }

        fn predict(
            &self,
            _point_in_machine_m: &Vector3<f64>,
            covariates: &dyn CovariateSource,
        ) -> Result<ResidualPrediction, CovariateProblem> {
            let temp_c = known_covariate(covariates, &self.0[0])?;
            let residual_m = Vector3::new((temp_c - 20.0) * 1e-6, 0.0, 0.0);
            let inside = (18.0..=22.0).contains(&temp_c);
            Ok(ResidualPrediction { residual_m, covariance_m2: Matrix3::identity() * 1e-14, inside })
        }

        fn unknown_m2(&self) -> Matrix3<f64> {
            Matrix3::identity() * 4e-12
        }

        fn sha256(&self) -> [u8; 32] {
            [7; 32]
        }
    }

    #[test]
    fn an_input_of_the_field_comes_from_the_reading_and_where_it_does_not_nothing_is_added() {
        let owned = OwnedField { field: Arc::new(Warm(["temp_air_c".to_owned()])), model_sha256: MODEL };
        let step = ResidualStep::new(Some(owned), 10.0);
        let sample = sample(true, CorrectionStatus::InVolume);
        assert!(step.asks_of(&sample));
        let of = |temp_c: f64, age_s: f64| {
            let mut covariates = Covariates::new();
            covariates.push("temp_air_c", temp_c, age_s).unwrap();
            step.correct(&sample, Some(&covariates))
        };
        let fresh = of(21.0, 1.0);
        assert_eq!(fresh.status, CorrectionStatus::InVolume);
        assert!((fresh.corrected_m[0] - sample.corrected_m[0] - 1e-6).abs() < 1e-15);
        assert_eq!(of(23.0, 1.0).status, CorrectionStatus::Extrapolated);
        let missing = [None, Some(&Covariates::new())].map(|covariates| step.correct(&sample, covariates));
        for (left_out, status) in missing
            .map(|sample| (sample, CorrectionStatus::CovariateMissing))
            .into_iter()
            .chain([(of(21.0, 11.0), CorrectionStatus::Stale), (of(21.0, -1.0), CorrectionStatus::Stale)])
        {
            assert_eq!((left_out.status, left_out.corrected_m), (status, sample.corrected_m));
            assert_eq!((left_out.residual_correction_m, left_out.covariance_m2[0]), ([0.0; 3], 4e-12));
            // It names the model that was asked, so that replay asks it too.
            assert_eq!(left_out.residual_model_sha256.to_bytes(), [7; 32]);
            assert!(left_out.corrected_valid);
        }
    }
}
