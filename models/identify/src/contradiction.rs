//! Finds lines that contradict the rest of their station, and what in the file explains them.
//!
//! Place in the flow: [`crate::plausibility`] calls [`check`] with the stations placed from nominal points (m, machine
//! frame). A wrong sign, exchanged columns or a wrong station name disagree by millimetres, machine errors by
//! micrometres. Each cause is tried on each line, the station is placed again from the lines so mended, and the
//! cause that leaves no contradiction with the fewest mended lines is offered as the explanation.

use crate::error::IdentifyError;
use crate::mistake::Mistake;
use crate::robust::median;
use crate::station_start::{PointAndLength, StationStart, residual_m, start};
use crate::verdict::{Seen, find_step};
use crate::zeros::{self, Line, Zeros};
use abbe_geometry::chain::nominal_point_m;
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_measurement::subset::spread;

/// Disagreement of a whole line (median, m) that no machine error makes: fifty times a poor machine's.
const CONTRADICTION_M: f64 = 2e-3;
/// Rounds of mending lines and placing the station again.
const ROUNDS: usize = 6;
/// Readings of a line that are looked at: enough for its median.
const LINE_READINGS: usize = 25;
/// Readings of a line that are looked at for a new zero: enough to say between which two it lies.
const ZERO_READINGS: usize = 200;
/// Groups of lines with one offset that a station is tentatively placed from.
const OFFSET_GROUPS: usize = 8;
/// What a machine leaves before it is corrected (m): with it, readings that a step explains are told from those it does not.
const RAW_MACHINE_M: f64 = 1e-4;
/// Parts of a station that are left out in turn, at most: each is a search for its place.
const MOST_PARTS: usize = 500;
/// Other lines named in a message.
const NAMED_LINES: usize = 4;

/// Nominal point and length of a reading.
pub(crate) fn point(reading: &RangeReading) -> PointAndLength {
    (nominal_point_m(reading.reading_m, reading.offset_m), reading.length_m)
}

/// One station's lines as readings' places in the campaign.
struct Suspects<'a> {
    campaign: &'a Campaign,
    /// All stations as placed from nominal points.
    placed: &'a [StationStart],
    lines: Vec<&'a [usize]>,
    absolute: bool,
}

/// Mistakes of a whole station that let it be placed where its readings as they are do not, in words.
pub(crate) fn of_whole_station(campaign: &Campaign, indices: &[usize], absolute: bool) -> Vec<String> {
    let explains = |mistake: &Mistake| {
        let mended: Vec<PointAndLength> =
            indices.iter().map(|place| point(&mistake.mended(campaign.readings[*place]))).collect();
        start(&mended, absolute).is_ok_and(|station| {
            let left = mended.iter().map(|one| residual_m(&station, one).abs());
            median(left.collect()).is_some_and(|median_m| median_m <= CONTRADICTION_M)
        })
    };
    let all = Mistake::all(0, 0).into_iter().filter(explains);
    all.map(|mistake| format!("it can be placed {}", mistake.text(campaign))).collect()
}

/// The station as it is placed where some of its lines are left out and the others agree: one line, or several at its beginning or its end, as
/// where a name was changed late. `None` where there is no such part, the smallest else.
pub(crate) fn without_some_lines(campaign: &Campaign, indices: &[usize], absolute: bool) -> Option<StationStart> {
    let lines: Vec<&[usize]> =
        indices.chunk_by(|a, b| campaign.readings[*a].line == campaign.readings[*b].line).collect();
    let count = lines.len();
    let suspects = Suspects { campaign, placed: &[], lines, absolute };
    let single = (0..count).map(|k| k..k + 1);
    let parts = single.chain((2..=count / 2).flat_map(|many| [count - many..count, 0..many]));
    let mut parts = parts.take(MOST_PARTS);
    parts.find_map(|left_out| {
        let kept: Vec<&[usize]> = (0..count).filter(|k| !left_out.contains(k)).map(|k| suspects.lines[k]).collect();
        let points: Vec<PointAndLength> = kept.iter().flat_map(|line| suspects.sample(line)).map(point).collect();
        let station = start(&points, absolute).ok()?;
        kept.iter().all(|line| suspects.median_m(line, &station, None) <= CONTRADICTION_M).then_some(station)
    })
}

/// Where the lengths of a station begin anew, if that explains why it cannot be placed, in words.
pub(crate) fn of_new_zeros(campaign: &Campaign, indices: &[usize], absolute: bool) -> Option<String> {
    let lines = indices.chunk_by(|a, b| campaign.readings[*a].line == campaign.readings[*b].line).collect();
    let suspects = Suspects { campaign, placed: &[], lines, absolute };
    suspects.new_zeros(zeros::one_change).or_else(|| suspects.new_zeros(zeros::each_line))
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
        let part = spread(line.len(), LINE_READINGS).into_iter();
        part.map(|place| &self.campaign.readings[line[place]])
    }

    /// Median disagreement of a line with a station (m): single outliers are for the robust weights, not for here.
    fn median_m(&self, line: &[usize], own: &StationStart, cause: Option<Mistake>) -> f64 {
        let disagreement = |reading: &RangeReading| match cause {
            Some(Mistake::OtherStation(k)) => residual_m(&self.placed[k], &point(reading)).abs(),
            Some(cause) => residual_m(own, &point(&cause.mended(*reading))).abs(),
            None => residual_m(own, &point(reading)).abs(),
        };
        median(self.sample(line).map(disagreement).collect()).unwrap_or(0.0)
    }

    /// Lines that must be mended so that nothing contradicts, starting from this position.
    fn mended_lines(&self, from: StationStart, cause: Mistake) -> Option<Vec<bool>> {
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
    fn points(&self, mended: &[bool], cause: Mistake) -> Vec<PointAndLength> {
        let mut points = Vec::new();
        for (line, mended) in self.lines.iter().zip(mended) {
            match (mended, cause) {
                (true, Mistake::OtherStation(_)) => {}
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
        let mut explained = self.explained(station);
        explained.sort_by_key(|(_, mended)| mended.iter().filter(|m| **m).count());
        let worst = (0..medians.len()).max_by(|a, b| medians[*a].total_cmp(&medians[*b])).unwrap_or(0);
        let named = |mended: &[bool]| -> Vec<usize> { (0..mended.len()).filter(|k| mended[*k]).collect() };
        let largest = |named: Vec<usize>| named.into_iter().max_by(|a, b| medians[*a].total_cmp(&medians[*b]));
        let line = explained.first().and_then(|(_, mended)| largest(named(mended))).unwrap_or(worst);
        let words = |(mistake, mended): &(Mistake, Vec<bool>)| {
            format!("it agrees {}{}", mistake.text(self.campaign), self.others(&named(mended), line))
        };
        let mut likely: Vec<String> = explained.iter().map(words).collect();
        // The station as it was placed is led astray by a zero that changed, and the step then looks like a motion, or like none.
        let placed = |problem| IdentifyError::Station { station: self.campaign.stations[station].clone(), problem };
        if likely.is_empty()
            && let Some(problem) = self.new_zeros(zeros::one_change)
        {
            return placed(problem);
        }
        likely.extend(self.step(station));
        // Zeros of single lines take up much of a motion, which goes first.
        if likely.is_empty()
            && let Some(problem) = self.new_zeros(zeros::each_line)
        {
            return placed(problem);
        }
        if likely.is_empty() {
            let all = "check its station name, its offsets, the order and unit of x, y, z and of the lengths, the sense of each axis, \
                       and whether the beam was lost or the tracer moved";
            likely.push(all.to_owned());
        }
        let (places, reading) = (self.lines[line], &self.campaign.readings[self.lines[line][0]]);
        IdentifyError::Contradiction {
            line: self.campaign.lines[reading.line as usize].clone(),
            station: self.campaign.stations[station].clone(),
            first: places[0] + 1,
            last: places[places.len() - 1] + 1,
            residual_mm: medians[line] * 1e3,
            explanation: likely.join("; or "),
        }
    }

    /// Every mistake that leaves no contradiction, with the lines that have it.
    fn explained(&self, station: usize) -> Vec<(Mistake, Vec<bool>)> {
        let starts = self.starts(self.placed[station]);
        let of = |mistake: Mistake| {
            // The last start is right where the whole station has the mistake.
            let all = start(&self.points(&vec![true; self.lines.len()], mistake), self.absolute).ok();
            let single = starts.iter().copied().filter(|_| mistake.is_of_single_lines());
            let mended = single.chain(all).filter_map(|from| self.mended_lines(from, mistake));
            Some((mistake, mended.min_by_key(|mended| mended.iter().filter(|m| **m).count())?))
        };
        Mistake::all(self.campaign.stations.len(), station).into_iter().filter_map(of).collect()
    }

    /// The instant from which on the station's readings agree among themselves, in words.
    fn step(&self, station: usize) -> Option<String> {
        let own = &self.placed[station];
        let mut places: Vec<usize> = self.lines.iter().flat_map(|line| line.iter().copied()).collect();
        places.sort_by(|a, b| {
            let time_s = |place: usize| self.campaign.readings[place].time_s;
            time_s(*a).total_cmp(&time_s(*b)).then(a.cmp(b))
        });
        let seen = |place: &usize| {
            let (point_m, length_m) = point(&self.campaign.readings[*place]);
            let sight = (point_m - own.position_m).normalize();
            let residual_m = residual_m(own, &(point_m, length_m));
            Seen { reading: *place, sight, residual_m, u_m: RAW_MACHINE_M }
        };
        let found = find_step(&places.iter().map(seen).collect::<Vec<_>>())?;
        let (before, after) = found.readings;
        let line = |place: usize| &self.campaign.lines[self.campaign.readings[place].line as usize];
        let what = match found.moved_m {
            Some(moved_m) => format!("the tracer moved by about {:.3} mm", moved_m.norm() * 1e3),
            None => format!("the beam was interrupted (the lengths shift by about {:.3} mm)", -found.dead_path_m * 1e3),
        };
        let time_s = |place: usize| self.campaign.readings[place].time_s;
        Some(format!(
            "{what} between readings {} and {} (line {} at {:.2} s, line {} at {:.2} s): give the station's readings from reading {} \
             on a station name of their own",
            before + 1,
            after + 1,
            line(before),
            time_s(before),
            line(after),
            time_s(after),
            after + 1
        ))
    }

    /// Where the lengths begin anew, in words; `None` where that explains nothing.
    fn new_zeros(&self, find: fn(&[Line]) -> Option<Zeros>) -> Option<String> {
        let mut lines = self.lines.clone();
        let time_s = |line: &[usize]| self.campaign.readings[line[0]].time_s;
        lines.sort_by(|a, b| time_s(a).total_cmp(&time_s(b)).then(a[0].cmp(&b[0])));
        let sampled = |line: &&[usize]| -> Vec<usize> {
            spread(line.len(), ZERO_READINGS).into_iter().map(|place| line[place]).collect()
        };
        let places: Vec<Vec<usize>> = lines.iter().map(sampled).collect();
        let of = |places: &Vec<usize>| -> Line { places.iter().map(|k| point(&self.campaign.readings[*k])).collect() };
        let found = find(&places.iter().map(of).collect::<Vec<Line>>())?;
        Some(self.zeros_in_words(&found, &places.concat()))
    }

    /// What begins anew where, and what to do about it; `places` are the readings that were looked at.
    fn zeros_in_words(&self, zeros: &Zeros, places: &[usize]) -> String {
        let line = |place: usize| &self.campaign.lines[self.campaign.readings[place].line as usize];
        if let ([begin], [shift_m]) = (zeros.begin.as_slice(), zeros.shifts_m.as_slice()) {
            let (before, after) = (places[begin - 1], places[*begin]);
            return format!(
                "its lengths begin anew between readings {} and {} (lines {} and {}), and shift by about {:.3} mm: the beam was \
                 interrupted, or the tracer was set to zero again; give the station's readings from reading {} on a station name of their own",
                before + 1,
                after + 1,
                line(before),
                line(after),
                shift_m * 1e3,
                after + 1
            );
        }
        let named: Vec<String> = zeros.begin.iter().take(NAMED_LINES).map(|k| line(places[*k]).clone()).collect();
        let more = if zeros.begin.len() > NAMED_LINES { " …" } else { "" };
        format!(
            "its lengths begin anew at {} of its {} lines ({}{more}): the tracer was set to zero there, and all lengths of a station must \
             count from one zero. Add to the lengths of each line what the tracer showed before it was set to zero, or measure them again \
             without setting it to zero; a station name for each line is no way out, since one line cannot place a station",
            zeros.begin.len(),
            self.lines.len(),
            named.join(", "),
        )
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
