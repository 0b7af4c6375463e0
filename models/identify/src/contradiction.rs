//! Finds lines that contradict the rest of their station, and what in the file explains them.
//!
//! Place in the flow: [`crate::plausibility`] calls [`check`] with the stations placed from nominal points (m, machine
//! frame). A wrong sign, exchanged columns or a wrong station name disagree by millimetres, machine errors by
//! micrometres. Each cause is tried on each line, the station is placed again from the lines so mended, and the
//! cause that leaves no contradiction with the fewest mended lines is offered as the explanation.

use crate::error::IdentifyError;
use crate::station_start::{PointAndLength, StationStart, residual_m, start};
use abbe_geometry::chain::nominal_point_m;
use abbe_measurement::campaign::{Campaign, RangeReading};

/// Disagreement of a whole line (median, m) that no machine error makes: fifty times a poor machine's.
const CONTRADICTION_M: f64 = 2e-3;
/// Rounds of mending lines and placing the station again.
const ROUNDS: usize = 6;
/// Readings of a line that are looked at: enough for its median.
const LINE_READINGS: usize = 25;
/// Groups of lines with one offset that a station is tentatively placed from.
const OFFSET_GROUPS: usize = 8;
/// Other lines named in a message.
const NAMED_LINES: usize = 4;

/// Nominal point and length of a reading.
pub(crate) fn point(reading: &RangeReading) -> PointAndLength {
    (nominal_point_m(reading.reading_m, reading.offset_m), reading.length_m)
}

/// A mistake that would explain a contradiction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cause {
    /// The offset has the wrong sign in this direction.
    Sign(usize),
    /// Two columns of axis positions are exchanged.
    Exchanged(usize, usize),
    /// The readings belong to this station.
    OtherStation(usize),
}

impl Cause {
    fn all(stations: usize, own: usize) -> Vec<Cause> {
        let mut all = vec![Cause::Sign(0), Cause::Sign(1), Cause::Sign(2)];
        all.extend([Cause::Exchanged(0, 1), Cause::Exchanged(0, 2), Cause::Exchanged(1, 2)]);
        all.extend((0..stations).filter(|k| *k != own).map(Cause::OtherStation));
        all
    }

    /// The reading as it would be without the mistake.
    fn mended(self, mut reading: RangeReading) -> RangeReading {
        match self {
            Cause::Sign(d) => reading.offset_m[d] = -reading.offset_m[d],
            Cause::Exchanged(a, b) => reading.reading_m.swap(a, b),
            Cause::OtherStation(station) => reading.station = station as u32,
        }
        reading
    }

    fn text(self, campaign: &Campaign) -> String {
        let letter = |d: usize| ['x', 'y', 'z'][d];
        match self {
            Cause::Sign(d) => {
                format!("when offset_{0}_mm changes its sign: correct the sign of offset_{0}_mm", letter(d))
            }
            Cause::Exchanged(a, b) => {
                let (a, b) = (letter(a), letter(b));
                format!("when {a}_mm and {b}_mm are exchanged: correct the order of these columns")
            }
            Cause::OtherStation(k) => {
                let name = &campaign.stations[k];
                format!("with station {name}: correct the station's name")
            }
        }
    }
}

/// One station's lines as readings' places in the campaign.
struct Suspects<'a> {
    campaign: &'a Campaign,
    /// All stations as placed from nominal points.
    placed: &'a [StationStart],
    lines: Vec<&'a [usize]>,
    absolute: bool,
}

/// Refuses the station when one of its lines contradicts the others.
pub(crate) fn check(
    campaign: &Campaign,
    indices: &[usize],
    placed: &[StationStart],
    station: usize,
    absolute: bool,
) -> Result<(), IdentifyError> {
    let lines = indices.chunk_by(|a, b| campaign.readings[*a].line == campaign.readings[*b].line).collect();
    let suspects = Suspects { campaign, placed, lines, absolute };
    let medians: Vec<f64> = suspects.lines.iter().map(|line| suspects.median_m(line, &placed[station], None)).collect();
    if medians.iter().all(|median_m| *median_m <= CONTRADICTION_M) {
        return Ok(());
    }
    Err(suspects.refusal(station, &medians))
}

impl Suspects<'_> {
    /// A few readings of a line, spread over it.
    fn sample<'b>(&'b self, line: &'b [usize]) -> impl Iterator<Item = &'b RangeReading> {
        line.iter().step_by(line.len().div_ceil(LINE_READINGS).max(1)).map(|k| &self.campaign.readings[*k])
    }

    /// Median disagreement of a line with a station (m): single outliers are for the robust weights, not for here.
    fn median_m(&self, line: &[usize], own: &StationStart, cause: Option<Cause>) -> f64 {
        let disagreement = |reading: &RangeReading| match cause {
            Some(Cause::OtherStation(k)) => residual_m(&self.placed[k], &point(reading)).abs(),
            Some(cause) => residual_m(own, &point(&cause.mended(*reading))).abs(),
            None => residual_m(own, &point(reading)).abs(),
        };
        let mut all: Vec<f64> = self.sample(line).map(disagreement).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    }

    /// Lines that must be mended so that nothing contradicts, starting from this position.
    fn mended_lines(&self, from: StationStart, cause: Cause) -> Option<Vec<bool>> {
        let mut station = from;
        let mut mended = Vec::new();
        for _ in 0..ROUNDS {
            let better =
                |line: &&[usize]| self.median_m(line, &station, Some(cause)) < self.median_m(line, &station, None);
            mended = self.lines.iter().map(better).collect();
            station = start(&self.points(&mended, cause), self.absolute).ok()?;
        }
        let left = |(line, mended): (&&[usize], &bool)| self.median_m(line, &station, mended.then_some(cause));
        let consistent = self.lines.iter().zip(&mended).map(left).all(|median_m| median_m <= CONTRADICTION_M);
        (consistent && mended.contains(&true)).then_some(mended)
    }

    /// Points of the station with the marked lines mended, or left out where they belong elsewhere.
    fn points(&self, mended: &[bool], cause: Cause) -> Vec<PointAndLength> {
        let mut points = Vec::new();
        for (line, mended) in self.lines.iter().zip(mended) {
            match (mended, cause) {
                (true, Cause::OtherStation(_)) => {}
                (true, cause) => points.extend(self.sample(line).map(|reading| point(&cause.mended(*reading)))),
                (false, _) => points.extend(self.sample(line).map(point)),
            }
        }
        points
    }

    /// The station from all lines, and from the lines of one offset alone: a wrong sign makes an offset of its own, so
    /// these lines are all right or all wrong.
    fn starts(&self, own: StationStart) -> Vec<StationStart> {
        let offset_m = |line: &[usize]| self.campaign.readings[line[0]].offset_m;
        let mut groups: Vec<([f64; 3], Vec<PointAndLength>)> = Vec::new();
        for line in &self.lines {
            match groups.iter().position(|(offset, _)| *offset == offset_m(line)) {
                Some(k) => groups[k].1.extend(self.sample(line).map(point)),
                None => groups.push((offset_m(line), self.sample(line).map(point).collect())),
            }
        }
        groups.sort_by_key(|(_, points)| std::cmp::Reverse(points.len()));
        let from_groups = groups.iter().take(OFFSET_GROUPS).filter_map(|(_, points)| start(points, self.absolute).ok());
        std::iter::once(own).chain(from_groups).collect()
    }

    fn refusal(&self, station: usize, medians: &[f64]) -> IdentifyError {
        let starts = self.starts(self.placed[station]);
        let causes = Cause::all(self.campaign.stations.len(), station);
        let explained = causes
            .into_iter()
            .flat_map(|cause| {
                // The last start is right where the whole station has the mistake.
                let all = start(&self.points(&vec![true; self.lines.len()], cause), self.absolute).ok();
                starts.iter().copied().chain(all).map(move |from| (cause, from))
            })
            .filter_map(|(cause, from)| self.mended_lines(from, cause).map(|mended| (cause, mended)))
            .min_by_key(|(_, mended)| mended.iter().filter(|m| **m).count());
        let worst = (0..medians.len()).max_by(|a, b| medians[*a].total_cmp(&medians[*b])).unwrap_or(0);
        let (line, explanation) = match &explained {
            Some((cause, mended)) => {
                let named: Vec<usize> = (0..mended.len()).filter(|k| mended[*k]).collect();
                let largest = named.iter().copied().max_by(|a, b| medians[*a].total_cmp(&medians[*b]));
                let line = largest.unwrap_or(worst);
                (line, format!("it agrees {}{}", cause.text(self.campaign), self.others(&named, line)))
            }
            None => (
                worst,
                "check its station name, its offsets, the order and unit of x, y, z, and whether the beam was lost"
                    .to_owned(),
            ),
        };
        let (places, reading) = (self.lines[line], &self.campaign.readings[self.lines[line][0]]);
        IdentifyError::Contradiction {
            line: self.campaign.lines[reading.line as usize].clone(),
            station: self.campaign.stations[station].clone(),
            first: places[0] + 1,
            last: places[places.len() - 1] + 1,
            residual_mm: medians[line] * 1e3,
            explanation,
        }
    }

    /// `; so do 5 more lines (S1-03, S1-07 …)`.
    fn others(&self, named: &[usize], but: usize) -> String {
        let others: Vec<&str> = named.iter().filter(|k| **k != but).map(|k| self.name(self.lines[*k])).collect();
        let shown = others.iter().take(NAMED_LINES).copied().collect::<Vec<_>>().join(", ");
        match others.len() {
            0 => String::new(),
            1 => format!("; so does line {shown}"),
            count if count > NAMED_LINES => format!("; so do {count} more lines ({shown} …)"),
            count => format!("; so do {count} more lines ({shown})"),
        }
    }

    fn name(&self, line: &[usize]) -> &str {
        &self.campaign.lines[self.campaign.readings[line[0]].line as usize]
    }
}
