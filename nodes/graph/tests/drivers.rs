//! Evidence for what recorded campaigns say of their uncertainty: that of the reflector's distance, so that a monitor on a
//! sound machine sees a mean square of one.

use crate::common::{HASH, bench};
use abbe_files::write_campaign;
use abbe_geometry::chain::nominal_point_m;
use abbe_graph::bag_campaign::{CampaignFromBag, JoinSettings, campaign_from_bag};
use abbe_graph::driver::{DriverConfig, open_scale, open_scale_again, open_tracer};
use abbe_graph::step::{GeometricStep, MonitorSettings, MonitorStep, ReadingBuffer};
use abbe_identify::{IdentifyOptions, identify};
use abbe_measurement::campaign::Campaign;
use abbe_msgs::bag::BagWriter;
use abbe_msgs::{Covariates, Message, ScaleReading, Stamp, Text, TracerReading};
use abbe_runtime::Shutdown;
use std::sync::Arc;

#[test]
fn regress_a_topic_that_the_bag_does_not_have_is_refused_with_those_that_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = BagWriter::create(folder.path().join("bag")).unwrap();
    let readings: Vec<ScaleReading> =
        (0..3).map(|sequence| ScaleReading { sequence, ..ScaleReading::default() }).collect();
    for reading in &readings {
        write(&mut writer, "/m/tracer/reading", &TracerReading::default());
        write(&mut writer, "/m/scale/reading", reading);
    }
    writer.finish().unwrap();
    let open = |topic: &str| {
        let config = DriverConfig::Bag { file: "bag".into(), topic: topic.to_owned() };
        open_scale(&config, folder.path(), &bench().machine, &Shutdown::manual(), None)
    };
    let refused = open("/n/scale/reading").err().unwrap().to_string();
    for words in ["no topic /n/scale/reading in ", "bag; it has: /m/scale/reading, /m/tracer/reading; name one"] {
        assert!(refused.contains(words), "{refused}");
    }
    let mut driver = open("/m/scale/reading").unwrap();
    assert!(std::iter::from_fn(|| driver.next_reading().unwrap()).eq(readings), "what was looked at comes as well");
    // One that the recorder named, and on which nothing came, as rosbag2 does.
    let metadata = folder.path().join("bag/metadata.yaml");
    let silent =
        "topics_with_message_count:\n    - topic_metadata:\n        name: /n/scale/reading\n      message_count: 0\n";
    let text = std::fs::read_to_string(&metadata).unwrap().replace("topics_with_message_count:\n", silent);
    std::fs::write(&metadata, text).unwrap();
    assert_eq!(open("/n/scale/reading").unwrap().next_reading().unwrap(), None);
}

/// Campaign files that a driver reads.
struct Recording(tempfile::TempDir);

impl Recording {
    fn of(campaign: &Campaign) -> Recording {
        let folder = tempfile::tempdir().unwrap();
        write_campaign(&folder.path().join("campaign.csv"), campaign).unwrap();
        Recording(folder)
    }

    fn config() -> DriverConfig {
        DriverConfig::Campaign { file: "campaign.csv".into() }
    }

    fn tracer(&self) -> Vec<TracerReading> {
        let mut driver =
            open_tracer(&Recording::config(), self.0.path(), &bench().machine, &Shutdown::manual(), None).unwrap();
        std::iter::from_fn(|| driver.next_reading().unwrap()).collect()
    }
}

#[test]
fn a_recording_that_is_repeated_comes_again_with_sequence_and_stamps_going_on() {
    let recording = Recording::of(&bench().campaign.part(&(0..50).collect::<Vec<_>>()));
    let machine = &bench().machine;
    let shutdown = Shutdown::manual();
    let mut once = open_scale(&Recording::config(), recording.0.path(), machine, &shutdown, None).unwrap();
    let first: Vec<ScaleReading> = std::iter::from_fn(|| once.next_reading().unwrap()).collect();
    let open = |from| open_scale_again(&Recording::config(), recording.0.path(), machine, &shutdown, from).unwrap();
    for from in [0, 30] {
        let mut again = open(from);
        let all: Vec<ScaleReading> = (0..150).map(|_| again.next_reading().unwrap().unwrap()).collect();
        assert_eq!(all[..50], first, "the first pass is the recording itself");
        let length = 50 - from as usize;
        for (place, reading) in all.iter().enumerate().skip(50) {
            let of_pass = (place - 50) % length;
            let original = &first[from as usize + of_pass];
            assert_eq!(*reading, ScaleReading { sequence: place as u64, stamp: reading.stamp, ..*original });
            let since =
                |list: &[ScaleReading], k: usize, begin: usize| list[k].stamp.to_nanos() - list[begin].stamp.to_nanos();
            assert!(since(&all, place, place - 1) > 0, "reading {place}");
            let (begin, of_first) = (place - of_pass, from as usize);
            assert_eq!(since(&all, place, begin), since(&first, of_first + of_pass, of_first), "reading {place}");
        }
    }
    let mut never = open(50);
    assert_eq!(
        std::iter::from_fn(|| never.next_reading().unwrap()).count(),
        50,
        "nothing is there to begin again with"
    );
}

/// Readings of every second line, or of the others.
fn half(odd: bool) -> Campaign {
    let campaign = &bench().campaign;
    let of_half = |k: &usize| (campaign.readings[*k].line % 2 == 1) == odd;
    campaign.part(&(0..campaign.readings.len()).filter(of_half).collect::<Vec<_>>())
}

#[test]
fn the_uncertainty_of_a_length_is_that_of_the_distance_and_not_of_the_travel() {
    let bench = bench();
    let told = Recording::of(&bench.campaign).tracer();
    assert_eq!(told.len(), bench.campaign.readings.len());
    let mut travelled_less = 0;
    for (told, reading) in told.iter().zip(&bench.campaign.readings) {
        let (_, station) = bench.model.station(told.station.as_str()).unwrap();
        let distance_m = (nominal_point_m(reading.reading_m, reading.offset_m) - station.position_m).norm();
        let expected_m = bench.machine.instrument.standard_m(distance_m);
        // Errors of some ten micrometres, of which the uncertainty holds some 1e-7.
        assert!((told.u_length_m - expected_m).abs() < 1e-10, "{} {expected_m}", told.u_length_m);
        travelled_less += usize::from(reading.length_m.abs() < 0.5 * distance_m);
    }
    assert!(travelled_less > told.len() / 2, "distance and travel differ, so that the test can tell");
}

#[test]
fn a_recording_that_cannot_place_its_station_states_the_uncertainty_of_the_travel() {
    let campaign = &bench().campaign;
    let few = Recording::of(&campaign.part(&[0, 1, 2, 3])).tracer();
    for (told, reading) in few.iter().zip(&campaign.readings) {
        let expected_m = bench().machine.instrument.standard_m(reading.length_m);
        assert!((told.u_length_m - expected_m).abs() < 1e-15, "{told:?}");
    }
}

#[test]
fn the_mean_square_over_a_sound_machine_is_one() {
    let machine = &bench().machine;
    let seen = half(false);
    let found =
        identify(&machine.machine, machine.instrument, &seen, &IdentifyOptions::default(), &mut |_| true).unwrap();
    let model = Arc::new(found.model);
    let recording = Recording::of(&half(true));
    let correcting = GeometricStep::new(Some((Arc::clone(&model), HASH)), 10.0);
    let settings = MonitorSettings { single_bound: 4.0, window: usize::MAX, match_within_s: 0.0005 };
    let mut monitor = MonitorStep::new(model, HASH, settings);
    let mut scale = open_scale(&Recording::config(), recording.0.path(), machine, &Shutdown::manual(), None).unwrap();
    for reading in recording.tracer() {
        let sample = correcting.correct(&scale.next_reading().unwrap().unwrap());
        assert!(monitor.corrected(&sample).is_empty());
        assert!(monitor.tracer(&reading).unwrap().residual_valid);
    }
    let health = monitor.health();
    assert_eq!(health.residuals, half(true).readings.len());
    let mean_square = health.mean_square.unwrap();
    println!("mean square over {} residuals: {mean_square:.3}", health.residuals);
    // Three deviations of χ²/n over some 1400 residuals are 0.11.
    assert!((mean_square - 1.0).abs() < 0.11, "{mean_square}");
}

/// A run as a recorder and a monitor hear it: stamps of scale and tracer a little apart, covariates of all ages, lines
/// without a name, an offset that changes within a line, a tracer that starts again, a beam that was lost.
fn run() -> Vec<(ScaleReading, TracerReading)> {
    let frame_id = Text::new("cmm").unwrap();
    let sequences = |k: u64| if k < 20 { 100 + k } else { k };
    let reading = |k: u64| {
        let at =
            |nanos: i64| Stamp::from_nanos(1_000_000_000 + i64::try_from(k).unwrap() * 10_000_000 + nanos).unwrap();
        let mut covariates = Covariates::new();
        covariates.push("temp_scale_x_c", 20.0 + k as f64, 0.5).unwrap();
        covariates.push("load_kg", 7.0, if k.is_multiple_of(3) { 60.0 } else { 1.0 }).unwrap();
        let offset_m = [0.0, 0.0, if k < 50 { -0.1 } else { -0.2 }];
        let reading_m = [k as f64 * 1e-3, 0.2, if k == 33 { f64::NAN } else { 0.3 }];
        let scale = ScaleReading { stamp: at(0), sequence: k, reading_m, offset_m, covariates, frame_id };
        let tracer = TracerReading {
            stamp: at(200_000),
            // It starts again at its twentieth reading, while it stands on S1.
            sequence: sequences(k),
            length_m: k as f64 * 1e-3,
            u_length_m: 1e-7,
            frame_id,
            station: Text::new(if k < 40 { "S1" } else { "S2" }).unwrap(),
            line: Text::new(if k % 20 < 10 { "" } else { "a" }).unwrap(),
        };
        (scale, tracer)
    };
    (0..60).map(reading).collect()
}

fn write<M: Message>(writer: &mut BagWriter, topic: &str, sample: &M) {
    writer.write(topic, sample, sample.stamp().to_nanos().unsigned_abs()).unwrap();
}

#[test]
fn regress_a_recorded_run_gives_offline_the_campaign_of_the_live_diagnosis() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("run");
    let mut writer = BagWriter::create(&bag).unwrap();
    // The monitor hears the tracer first, the recorder the scales; another machine is on the network as well.
    let join = JoinSettings { max_covariate_age_s: 10.0, ..JoinSettings::default() };
    let mut live = ReadingBuffer::new("cmm", join.match_within_s, join.max_covariate_age_s);
    for (scale, tracer) in run() {
        write(&mut writer, "/cmm/scale/reading", &scale);
        write(&mut writer, "/cmm/tracer/reading", &tracer);
        let frame_id = Text::new("other").unwrap();
        let reading_m = [9.0; 3];
        write(&mut writer, "/other/scale/reading", &ScaleReading { frame_id, reading_m, ..scale });
        write(&mut writer, "/other/tracer/reading", &TracerReading { frame_id, length_m: 9.0, ..tracer });
        live.tracer(&tracer);
        live.scale(&scale);
    }
    let (_, last) = run()[59];
    let alone = TracerReading { stamp: Stamp::from_seconds(1.8).unwrap(), sequence: 60, ..last };
    write(&mut writer, "/cmm/tracer/reading", &alone);
    live.tracer(&alone);
    live.finish();
    writer.finish().unwrap();

    let offline = campaign_from_bag(&bag, "cmm", &join).unwrap();
    assert_eq!(offline.campaign, live.campaign(None));
    assert_eq!(offline.campaign.readings.len(), 39, "40 since the tracer started again, less one that is no number");
    assert_eq!(offline.campaign.lines, ["S1", "a", "S2", "a-2"]);
    assert_eq!(offline.campaign.covariate("load_kg").unwrap().values.iter().flatten().count(), 27);
    for says in [
        "1 tracer readings have no scale reading within 0.5 ms",
        "20 tracer readings are from before their tracer started again",
        "1 tracer readings are not usable",
        "20 scale readings have covariates older than 10 s",
        "120 readings are of another frame or namespace",
    ] {
        assert!(offline.left_out.iter().any(|words| words.contains(says)), "{says}: {:?}", offline.left_out);
    }
}

#[test]
fn regress_covariates_from_after_their_reading_are_counted_as_missing_from_a_bag() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("run");
    let mut writer = BagWriter::create(&bag).unwrap();
    for (mut scale, tracer) in run() {
        // Clocks agree to a millisecond; what is further ahead has an age that nobody knows.
        let age_s = if scale.sequence.is_multiple_of(2) { -1e-3 } else { -1.5e-3 };
        scale.covariates = Covariates::new();
        scale.covariates.push("load_kg", 7.0, age_s).unwrap();
        write(&mut writer, "/cmm/scale/reading", &scale);
        write(&mut writer, "/cmm/tracer/reading", &tracer);
    }
    writer.finish().unwrap();
    let CampaignFromBag { campaign, left_out, .. } = campaign_from_bag(&bag, "cmm", &JoinSettings::default()).unwrap();
    let told = "30 scale readings have covariates older than 10 s, or from after the reading, which are missing";
    assert!(left_out.iter().any(|words| words == told), "{left_out:?}");
    assert_eq!(campaign.covariate("load_kg").unwrap().values.iter().flatten().count(), 20);
}

#[test]
fn a_bag_of_another_machine_or_of_several_is_refused_until_one_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("run");
    let mut writer = BagWriter::create(&bag).unwrap();
    for (scale, tracer) in run() {
        for namespace in ["left", "right"] {
            write(&mut writer, &format!("/{namespace}/scale/reading"), &scale);
            write(&mut writer, &format!("/{namespace}/tracer/reading"), &tracer);
        }
    }
    writer.finish().unwrap();
    let refused = |frame: &str, join: &JoinSettings| campaign_from_bag(&bag, frame, join).unwrap_err().to_string();
    let join = JoinSettings::default();
    assert!(refused("cmm", &join).contains("/left/scale/reading, /right/scale/reading; name one"));
    assert!(refused("bridge", &join).contains("another machine"));
    let left = JoinSettings { namespace: Some("/left".to_owned()), ..join.clone() };
    assert_eq!(campaign_from_bag(&bag, "cmm", &left).unwrap().campaign.readings.len(), 39);
    let strict = JoinSettings { match_within_s: 0.0001, ..left };
    assert!(refused("cmm", &strict).contains("none of 60 tracer readings has a usable scale reading within 0.1 ms"));
}
