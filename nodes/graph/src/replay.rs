//! Replay of a recorded run: do the same scale readings give the same corrected messages, byte for byte?
//!
//! Place in the flow: `abbe replay` runs every recorded scale reading through the steps of the nodes and compares
//! the CDR bytes with those recorded. Each recorded message is compared once: a reading belongs to the earliest message
//! of its topic that repeats its stamp, sequence, position, offset and frame and has no reading yet, so a source that
//! restarted, or plays the same readings again, is compared like any other. A recorded message names the models that
//! made it, and is computed with these and no others. The age from which a covariate was stale is named nowhere, and may have been
//! set during the run: it is given as often as it changed, in order, and no node goes back to one before. What the order of the samples adds to a status is found again from
//! the corrected ones, which lie in the order in which they were made; what the network said of another publisher, and
//! that a node was deactivated, is taken as recorded. No clock, no transport. Memory is that of what has no partner.

use crate::step::{GeometricStep, Mark, OwnedField, ResidualStep, StreamWatch, Verdict};
use crate::topics;
use abbe_geometry::model::MachineModel;
use abbe_msgs::bag::{BagError, BagMessage, messages};
use abbe_msgs::cdr::{self, CdrError};
use abbe_msgs::ros;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, ScaleReading, Sha256, Stamp, Text};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;
use std::sync::Arc;
use thiserror::Error;

/// Why a recording cannot be replayed.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The bag cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A corrected sample cannot be encoded.
    #[error(transparent)]
    Encode(#[from] CdrError),
}

/// The models of a run, and the ages from which a covariate was stale.
pub struct ReplaySteps {
    /// One step for each age and geometric model, and for none.
    geometric: Vec<Vec<GeometricStep>>,
    /// One step for each age and residual model.
    residual: Vec<Vec<ResidualStep>>,
}

/// Which of the ages the geometric and the residual node had.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Ages {
    geometric: usize,
    residual: usize,
}

impl ReplaySteps {
    /// Steps with these models, and these ages (s) in the order in which they held; at least one is needed: nothing comes out without.
    pub fn new(
        models: &[(Arc<MachineModel>, Sha256)],
        fields: &[OwnedField],
        max_covariate_ages_s: &[f64],
    ) -> ReplaySteps {
        let with_models = |age_s: &f64| {
            let models = models.iter().cloned().map(Some).chain([None]);
            models.map(|model| GeometricStep::new(model, *age_s)).collect()
        };
        let with_fields =
            |age_s: &f64| fields.iter().map(|field| ResidualStep::new(Some(field.clone()), *age_s)).collect();
        ReplaySteps {
            geometric: max_covariate_ages_s.iter().map(with_models).collect(),
            residual: max_covariate_ages_s.iter().map(with_fields).collect(),
        }
    }

    /// What two nodes may have had since the message before, the fewest changes first.
    fn ages(&self, before: Ages) -> impl Iterator<Item = Ages> + use<> {
        let left = |place: usize| self.geometric.len().saturating_sub(place + 1);
        let (geometric, residual) = (left(before.geometric), left(before.residual));
        (0..=geometric + residual).flat_map(move |changes| {
            (changes.saturating_sub(residual)..=changes.min(geometric)).map(move |further| Ages {
                geometric: before.geometric + further,
                residual: before.residual + changes - further,
            })
        })
    }

    /// What the steps make of a reading with the models of this recorded message; `None` where one was not given.
    fn correct(&self, reading: &ScaleReading, recorded: &Recorded, ages: Ages) -> Option<CorrectedCoordinates> {
        let mut geometric = self.geometric.get(ages.geometric)?.iter();
        let geometric = geometric.find(|step| step.model_sha256() == recorded.model_sha256)?;
        let mut sample = recorded.verdict.apply(geometric.correct(reading));
        if !recorded.residual_model_sha256.is_none() {
            let mut residual = self.residual.get(ages.residual)?.iter();
            let residual = residual.find(|step| step.residual_sha256() == recorded.residual_model_sha256)?;
            sample = residual.correct(&sample, Some(&reading.covariates));
        }
        let sample = if recorded.was_inactive { sample.while_inactive() } else { sample };
        Some(if recorded.beside_another { sample.beside_another_publisher() } else { sample })
    }

    /// Hashes of all models given.
    fn hashes(&self) -> impl Iterator<Item = Sha256> {
        let geometric = self.geometric.iter().flatten().map(GeometricStep::model_sha256);
        let residual = self.residual.iter().flatten().map(ResidualStep::residual_sha256);
        geometric.chain(residual).filter(|hash| !hash.is_none())
    }
}

/// A recorded corrected message: the models it names, and its fields as CDR.
struct Recorded {
    sequence: u64,
    /// What the order of the samples makes of it.
    verdict: Verdict,
    /// Whether another program published the topic: no sample tells that, so it is taken as recorded.
    beside_another: bool,
    /// Whether a correcting node was deactivated: that is a command, so it is taken as recorded.
    was_inactive: bool,
    model_sha256: Sha256,
    residual_model_sha256: Sha256,
    cdr: Vec<u8>,
    /// Place among the corrected messages of its topic.
    place: u64,
}

impl Recorded {
    fn hashes(&self) -> impl Iterator<Item = Sha256> {
        [self.model_sha256, self.residual_model_sha256].into_iter().filter(|hash| !hash.is_none())
    }
}

/// What a corrected message repeats of its reading, bit by bit.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    stamp: Stamp,
    sequence: u64,
    numbers: [u64; 6],
    frame_id: [u8; 32],
}

impl Key {
    fn new<const N: usize>(
        stamp: Stamp,
        sequence: u64,
        reading_m: [f64; 3],
        offset_m: [f64; 3],
        frame_id: &Text<N>,
    ) -> Key {
        let [x, y, z] = reading_m.map(f64::to_bits);
        let [u, v, w] = offset_m.map(f64::to_bits);
        let frame_id = Sha256::of(frame_id.as_str().as_bytes()).to_bytes();
        Key { stamp, sequence, numbers: [x, y, z, u, v, w], frame_id }
    }

    fn of_reading(reading: &ScaleReading) -> Key {
        Key::new(reading.stamp, reading.sequence, reading.reading_m, reading.offset_m, &reading.frame_id)
    }

    fn of_corrected(sample: &CorrectedCoordinates) -> Key {
        Key::new(sample.stamp, sample.sequence, sample.reading_m, sample.offset_m, &sample.frame_id)
    }
}

/// Outcome of one corrected topic.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TopicOutcome {
    /// The corrected topic.
    pub topic: String,
    /// Scale readings that belong to it.
    pub readings: u64,
    /// Corrected messages recorded.
    pub recorded: u64,
    /// Corrected messages that came out byte by byte as recorded.
    pub identical: u64,
    /// Those of them that hold a residual correction.
    pub with_residual: u64,
    /// Messages that came out otherwise.
    pub different: u64,
    /// Messages of a model that was not given, so that they could not be compared.
    pub not_comparable: u64,
    /// Scale readings without a corrected message.
    pub missing: u64,
    /// Corrected messages that repeat one that has been compared.
    pub repeated: u64,
    /// Corrected messages without a scale reading.
    pub additional: u64,
    /// Messages recorded after one of a later reading.
    pub reordered: u64,
    /// How often the sequence of the readings went back: their source began anew.
    pub restarts: u64,
    /// How often the corrected messages go on as those of a node that has seen nothing before.
    pub corrector_restarts: u64,
    /// How often a message came out with a later one of the ages given than the one before.
    pub changes_of_age: u64,
    /// Sequence of the first message that is not as it should be.
    pub first_fault: Option<u64>,
}

impl TopicOutcome {
    /// Whether each message was compared, in its order, and came out as recorded.
    pub fn is_identical(&self) -> bool {
        let faults =
            [self.different, self.not_comparable, self.missing, self.repeated, self.additional, self.reordered];
        self.identical > 0 && faults.iter().all(|count| *count == 0)
    }
}

/// Outcome of a replay.
#[derive(Debug, Default)]
pub struct ReplayOutcome {
    /// Each corrected topic of the bag; those that its scale readings should have given and that are not there too.
    pub topics: Vec<TopicOutcome>,
    /// Scale readings in the bag.
    pub readings: u64,
    /// Hashes that recorded messages name and that belong to no model given.
    pub models_not_given: BTreeSet<String>,
    /// Hashes of models given that no recorded message names.
    pub models_not_named: BTreeSet<String>,
    /// Why the bag could be read only up to here.
    pub damage: Option<BagError>,
}

impl ReplayOutcome {
    /// Whether everything in the bag was compared and came out as recorded.
    pub fn is_identical(&self) -> bool {
        self.damage.is_none() && !self.topics.is_empty() && self.topics.iter().all(TopicOutcome::is_identical)
    }
}

/// Runs the scale readings of a bag through the steps and compares with what was recorded.
///
/// # Errors
/// A bag that cannot be opened, a message that is not what its topic says, a sample that cannot be encoded. A bag that
/// is damaged is compared as far as it can be read.
pub fn replay(bag: &Path, steps: &ReplaySteps) -> Result<ReplayOutcome, ReplayError> {
    let (pairing, damage) = Pairing::of(bag)?;
    let mut streams: Vec<Stream> = pairing.corrected.iter().map(|(topic, scale)| Stream::new(topic, scale)).collect();
    let mut named = BTreeSet::new();
    let mut outcome = ReplayOutcome { readings: pairing.readings, damage, ..ReplayOutcome::default() };
    // The first look has found what is damaged.
    each(bag, |message| streams.iter_mut().try_for_each(|stream| stream.take(&message, steps, &mut named)))?;
    tell_repeated(bag, &mut streams)?;
    outcome.topics = streams.into_iter().map(Stream::end).collect();
    let given: BTreeSet<Sha256> = steps.hashes().collect();
    outcome.models_not_given = named.difference(&given).map(|sha256| sha256.to_hex()).collect();
    outcome.models_not_named = given.difference(&named).map(|sha256| sha256.to_hex()).collect();
    Ok(outcome)
}

/// Hands on each message; gives why the rest cannot be read.
fn each(
    bag: &Path,
    mut take: impl FnMut(BagMessage) -> Result<(), ReplayError>,
) -> Result<Option<BagError>, ReplayError> {
    for message in messages(bag)? {
        match message {
            Ok(message) => take(message)?,
            Err(damage) => return Ok(Some(damage)),
        }
    }
    Ok(None)
}

/// Which scale topic each corrected topic comes from.
struct Pairing {
    /// Corrected topic, and its scale topic where there is one.
    corrected: Vec<(String, Option<String>)>,
    readings: u64,
}

impl Pairing {
    /// Looks through the bag once; the corrected topic of a scale topic lies in the same namespace.
    fn of(bag: &Path) -> Result<(Pairing, Option<BagError>), ReplayError> {
        let (mut scales, mut corrected) = (BTreeMap::<String, u64>::new(), BTreeSet::new());
        let damage = each(bag, |message| {
            if message.ros_type() == ScaleReading::ROS_TYPE {
                *scales.entry(message.topic().to_owned()).or_default() += 1;
            } else if message.ros_type() == CorrectedCoordinates::ROS_TYPE && is_corrected(message.topic()) {
                corrected.insert(message.topic().to_owned());
            }
            Ok(())
        })?;
        let readings = scales.values().sum();
        let only = (scales.len() == 1).then(|| scales.keys().next()).flatten();
        let scale_of = |topic: &String| {
            let namespace = namespace_of(topic);
            let own = scales.keys().find(|scale| scale.strip_suffix(topics::SCALE_READING) == Some(namespace));
            own.or(only).cloned()
        };
        let mut pairs: Vec<(String, Option<String>)> =
            corrected.iter().map(|topic| (topic.clone(), scale_of(topic))).collect();
        for scale in scales.keys() {
            if !pairs.iter().any(|(_, of)| of.as_ref() == Some(scale)) {
                let namespace = scale.strip_suffix(topics::SCALE_READING).unwrap_or("/");
                pairs.push((format!("{namespace}{}", topics::CORRECTED), Some(scale.clone())));
            }
        }
        Ok((Pairing { corrected: pairs, readings }, damage))
    }
}

/// Whether a topic holds what the correcting nodes publish.
fn is_corrected(topic: &str) -> bool {
    topic.rsplit('/').next() == Some(topics::CORRECTED)
}

/// Namespace of a corrected topic, with the slash at its end.
fn namespace_of(topic: &str) -> &str {
    topic.strip_suffix(topics::GEOMETRIC).or(topic.strip_suffix(topics::CORRECTED)).unwrap_or("/")
}

/// A corrected topic and the readings that it comes from, while the bag is read.
struct Stream {
    scale: Option<String>,
    /// Readings whose corrected message has not come yet, as they were recorded, with their places.
    readings: BTreeMap<Key, VecDeque<(u64, BagMessage)>>,
    /// Corrected messages whose reading has not come yet.
    corrected: BTreeMap<Key, VecDeque<Recorded>>,
    /// Sequence of the reading before.
    sequence: Option<u64>,
    /// What follows what, as the corrector saw it.
    watch: StreamWatch,
    /// Latest place of a reading and of a corrected message that were compared.
    latest: Option<(u64, u64)>,
    /// Ages with which the message before came out.
    ages: Ages,
    outcome: TopicOutcome,
}

impl Stream {
    fn new(topic: &str, scale: &Option<String>) -> Stream {
        Stream {
            scale: scale.clone(),
            readings: BTreeMap::new(),
            corrected: BTreeMap::new(),
            sequence: None,
            watch: StreamWatch::default(),
            latest: None,
            ages: Ages::default(),
            outcome: TopicOutcome { topic: topic.to_owned(), ..TopicOutcome::default() },
        }
    }

    fn take(
        &mut self,
        message: &BagMessage,
        steps: &ReplaySteps,
        named: &mut BTreeSet<Sha256>,
    ) -> Result<(), ReplayError> {
        if Some(message.topic()) == self.scale.as_deref() && message.ros_type() == ScaleReading::ROS_TYPE {
            let reading: ScaleReading = message.decode()?;
            let (key, place) = (Key::of_reading(&reading), self.outcome.readings);
            self.outcome.readings += 1;
            self.outcome.restarts += u64::from(self.sequence.is_some_and(|before| reading.sequence <= before));
            self.sequence = Some(reading.sequence);
            match pop(&mut self.corrected, &key) {
                Some(recorded) => self.compare(&reading, place, &recorded, steps)?,
                None => self.readings.entry(key).or_default().push_back((place, message.clone())),
            }
        } else if message.topic() == self.outcome.topic {
            let sample: CorrectedCoordinates = message.decode()?;
            let CorrectedCoordinates { sequence, model_sha256, residual_model_sha256, status, .. } = sample;
            // A sample of another frame is none of the stream.
            let is_own = status != CorrectionStatus::OtherFrame;
            let mark = Mark::of_reading(&sample);
            let mut verdict = if is_own { self.watch.look(mark) } else { Verdict::InOrder };
            if is_unmarked(verdict, &sample) {
                // A node that was started again has seen nothing of what came before.
                self.watch = StreamWatch::default();
                verdict = self.watch.look(mark);
                self.outcome.corrector_restarts += 1;
            }
            // Field by field as this program writes them: other recorders pad, and write another byte order.
            let cdr = cdr::encode(&message.decode_ros::<ros::CorrectedCoordinates>()?)?;
            let place = self.outcome.recorded;
            let beside_another = status == CorrectionStatus::OtherPublisher;
            let was_inactive = status == CorrectionStatus::Inactive;
            let recorded = Recorded {
                sequence,
                verdict,
                beside_another,
                was_inactive,
                model_sha256,
                residual_model_sha256,
                cdr,
                place,
            };
            self.outcome.recorded += 1;
            named.extend(recorded.hashes());
            let key = Key::of_corrected(&sample);
            match pop(&mut self.readings, &key) {
                Some((place, reading)) => self.compare(&reading.decode()?, place, &recorded, steps)?,
                None => self.corrected.entry(key).or_default().push_back(recorded),
            }
        }
        Ok(())
    }

    fn compare(
        &mut self,
        reading: &ScaleReading,
        place: u64,
        recorded: &Recorded,
        steps: &ReplaySteps,
    ) -> Result<(), ReplayError> {
        let in_order = match self.latest {
            Some((reading_place, corrected_place)) => (place > reading_place) == (recorded.place > corrected_place),
            None => true,
        };
        self.latest = self.latest.max(Some((place, recorded.place)));
        let is_identical = self.is_identical(reading, recorded, steps)?;
        let outcome = &mut self.outcome;
        let (count, is_fault) = match is_identical {
            None => (&mut outcome.not_comparable, true),
            Some(false) => (&mut outcome.different, true),
            Some(true) => {
                outcome.with_residual += u64::from(!recorded.residual_model_sha256.is_none());
                (&mut outcome.identical, false)
            }
        };
        *count += 1;
        outcome.reordered += u64::from(!in_order);
        if is_fault || !in_order {
            outcome.first_fault.get_or_insert(recorded.sequence);
        }
        Ok(())
    }

    /// Whether a message comes out as recorded with one of the ages given; `None` where a model of it was not given.
    fn is_identical(
        &mut self,
        reading: &ScaleReading,
        recorded: &Recorded,
        steps: &ReplaySteps,
    ) -> Result<Option<bool>, ReplayError> {
        for ages in steps.ages(self.ages) {
            let Some(sample) = steps.correct(reading, recorded, ages) else { return Ok(None) };
            if cdr::encode(&sample.to_ros())? == recorded.cdr {
                self.outcome.changes_of_age += u64::from(ages != self.ages);
                self.ages = ages;
                return Ok(Some(true));
            }
        }
        Ok(Some(false))
    }

    /// Counts what has no partner.
    fn end(mut self) -> TopicOutcome {
        self.outcome.missing = self.readings.values().map(|queue| queue.len() as u64).sum();
        let without = self.corrected.values().map(|queue| queue.len() as u64).sum::<u64>();
        self.outcome.additional = without - self.outcome.repeated;
        let unread = self.readings.keys().chain(self.corrected.keys()).map(|key| key.sequence).min();
        self.outcome.first_fault = self.outcome.first_fault.or(unread);
        self.outcome
    }
}

/// Whether a sample lacks what a node that saw the whole stream would have said of it.
fn is_unmarked(verdict: Verdict, sample: &CorrectedCoordinates) -> bool {
    let unmarked = match verdict {
        Verdict::InOrder => false,
        Verdict::OutOfOrder => sample.status.worse_of(CorrectionStatus::OutOfOrder) != sample.status,
        Verdict::SeveralSources => true,
    };
    unmarked && sample.corrected_valid
}

fn pop<T>(waiting: &mut BTreeMap<Key, VecDeque<T>>, key: &Key) -> Option<T> {
    let queue = waiting.get_mut(key)?;
    let first = queue.pop_front();
    if queue.is_empty() {
        waiting.remove(key);
    }
    first
}

/// Of the messages without a reading, counts those that repeat another: a reading of theirs is in the bag.
fn tell_repeated(bag: &Path, streams: &mut [Stream]) -> Result<(), ReplayError> {
    if streams.iter().all(|stream| stream.corrected.is_empty()) {
        return Ok(());
    }
    let mut known: Vec<BTreeSet<Key>> = streams.iter().map(|_| BTreeSet::new()).collect();
    each(bag, |message| {
        if message.ros_type() == ScaleReading::ROS_TYPE {
            let key = Key::of_reading(&message.decode()?);
            for (stream, known) in streams.iter().zip(&mut known) {
                if Some(message.topic()) == stream.scale.as_deref() && stream.corrected.contains_key(&key) {
                    known.insert(key);
                }
            }
        }
        Ok(())
    })?;
    for (stream, known) in streams.iter_mut().zip(known) {
        let repeated = known.iter().filter_map(|key| stream.corrected.get(key)).map(|queue| queue.len() as u64);
        stream.outcome.repeated = repeated.sum();
    }
    Ok(())
}
