//! One valid sample of every message, with a different value in every field, so that a mix-up of
//! two fields shows.

#![allow(dead_code, unreachable_pub, missing_docs)] // each test uses its part
#![allow(clippy::unwrap_used)] // the samples are constants

use abbe_msgs::standard::{
    ColorRgba, DiagnosticArray, DiagnosticStatus, Header, JointState, KeyValue, Marker, MarkerArray, Point,
    PointStamped, Pose, Quaternion, TfMessage, TransformStamped, Vector3,
};
use abbe_msgs::{
    CorrectedCoordinates, CorrectionStatus, Covariates, RangeResidual, ResidualStatus, ScaleReading, Sha256, Stamp,
    Text, TracerReading,
};

fn stamp() -> Stamp {
    Stamp::new(1_700_000_000, 123_456_789).unwrap()
}

pub fn scales() -> ScaleReading {
    let mut covariates = Covariates::new();
    covariates.push("temp_scale_x_c", 20.125, 0.5).unwrap();
    covariates.push("feed_mm_s", 40.0, 0.0).unwrap();
    ScaleReading {
        stamp: stamp(),
        sequence: 7,
        reading_m: [0.1, 0.2, 0.3],
        offset_m: [0.01, -0.02, -0.15],
        covariates,
        frame_id: Text::new("bridge").unwrap(),
    }
}

pub fn tracer() -> TracerReading {
    TracerReading {
        stamp: stamp(),
        sequence: 8,
        length_m: 0.432_1,
        u_length_m: 0.2e-6,
        frame_id: Text::new("bridge").unwrap(),
        station: Text::new("S1").unwrap(),
        line: Text::new("x-line-3").unwrap(),
    }
}

pub fn corrected() -> CorrectedCoordinates {
    CorrectedCoordinates {
        stamp: stamp(),
        sequence: 9,
        reading_m: [0.1, 0.2, 0.3],
        offset_m: [0.01, -0.02, -0.15],
        geometric_correction_m: [1.0e-6, 2.0e-6, 3.0e-6],
        effect_correction_m: [4.0e-6, 5.0e-6, 6.0e-6],
        residual_correction_m: [7.0e-6, 8.0e-6, 9.0e-6],
        corrected_m: [0.110_012, 0.180_015, 0.150_018],
        covariance_m2: [1.0, 0.1, 0.2, 0.1, 2.0, 0.3, 0.2, 0.3, 3.0].map(|v| v * 1.0e-14),
        model_sha256: Sha256::of(b"model"),
        residual_model_sha256: Sha256::of(b"residual model"),
        frame_id: Text::new("bridge").unwrap(),
        corrected_valid: true,
        status: CorrectionStatus::Extrapolated,
    }
}

pub fn residual() -> RangeResidual {
    RangeResidual {
        stamp: stamp(),
        sequence: 10,
        measured_length_m: 0.5,
        predicted_length_m: 0.499_999,
        residual_m: 1.0e-6,
        u_residual_m: 0.3e-6,
        model_sha256: Sha256::of(b"model"),
        frame_id: Text::new("bridge").unwrap(),
        station: Text::new("S1").unwrap(),
        residual_valid: true,
        status: ResidualStatus::OutOfBounds,
    }
}

pub fn point() -> PointStamped {
    PointStamped::from_corrected(&corrected()).unwrap()
}

pub fn joints() -> JointState {
    JointState {
        velocity: vec![0.4, 0.5, 0.6],
        effort: vec![7.0],
        ..JointState::from_scales(&scales(), ["x", "y", "z"])
    }
}

pub fn diagnostics() -> DiagnosticArray {
    let value = |key: &str, value: &str| KeyValue { key: key.to_owned(), value: value.to_owned() };
    DiagnosticArray {
        header: Header::new(stamp(), "bridge"),
        status: vec![
            DiagnosticStatus {
                level: DiagnosticStatus::WARN,
                name: "monitor".to_owned(),
                message: "residuals grow".to_owned(),
                hardware_id: "bridge-7".to_owned(),
                values: vec![value("residual_rms_um", "0.61"), value("stations", "4")],
            },
            DiagnosticStatus::default(),
        ],
    }
}

pub fn frames() -> TfMessage {
    let mut turned = TransformStamped::at(stamp(), "bridge", "bridge/ram", [0.1, 0.2, 0.3]);
    turned.transform.rotation = Quaternion { x: 0.5, y: -0.5, z: 0.25, w: 0.75 };
    TfMessage { transforms: vec![turned, TransformStamped::at(stamp(), "bridge/ram", "bridge/tip", [0.4, 0.5, 0.6])] }
}

pub fn markers() -> MarkerArray {
    let color = ColorRgba { r: 0.5, g: 0.25, b: 0.125, a: 1.0 };
    let full = Marker {
        ns: "error".to_owned(),
        id: 3,
        kind: Marker::ARROW,
        action: Marker::DELETE,
        pose: Pose { position: Point { x: 1.0, y: 2.0, z: 3.0 }, orientation: Quaternion::default() },
        scale: Vector3 { x: 0.01, y: 0.02, z: 0.03 },
        color,
        frame_locked: true,
        points: vec![Point { x: 4.0, y: 5.0, z: 6.0 }],
        colors: vec![color],
        text: "1 µm".to_owned(),
        ..Marker::new(Header::new(stamp(), "bridge"))
    };
    MarkerArray { markers: vec![full, Marker::new(Header::new(stamp(), "bridge"))] }
}
