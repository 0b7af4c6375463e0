//! Standard messages of other programs as samples: positions of joints, points, ranges, temperatures.
//!
//! Place in the flow: in the gateway of the scale or the tracer node, under the driver `ros`. Pure: a message and the instant
//! of its arrival, on the clock that the node goes by, in, a sample out, or why it is none. Metres, degrees Celsius, hectopascal and per cent out, each unit that
//! which its message has by definition in; a bare number is taken over as it is, and the driver knows its unit. The sequence
//! is the driver's to count: these messages have none.

use abbe_msgs::standard::{
    Float64, FluidPressure, Header, JointState, PointStamped, Range, RelativeHumidity, Temperature,
};
use abbe_msgs::types::NAME_CAPACITY;
use abbe_msgs::{Covariates, Message, RosType, ScaleReading, Stamp, Text, TracerReading};
use serde::{Deserialize, Serialize};

use crate::ros::Clock;

/// Zero of degrees Celsius (K): no temperature is below it.
const ABSOLUTE_ZERO_C: f64 = -273.15;
/// Bits of the mantissa of a `float32`: a range has its last half digit as an uncertainty beside the instrument's.
const HALF_DIGIT: f64 = f32::EPSILON as f64 / 2.0;

/// What a driver wants of a topic of others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Foreign {
    /// What comes.
    pub message: ForeignMessage,
    /// Frame that a message has to name; one without a frame of its own may name none.
    pub frame_id: String,
    /// Machine frame, which samples name.
    pub machine_frame_id: String,
    /// Whether the instant is that of the header; otherwise that of arrival.
    pub is_stamped: bool,
}

/// Which message, and what it does not tell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum ForeignMessage {
    /// `sensor_msgs/JointState` as a scale reading: names of the joints X, Y, Z, and the offset (m).
    Joints([String; 3], [f64; 3]),
    /// `geometry_msgs/PointStamped` as a scale reading, with the offset (m).
    Position([f64; 3]),
    /// `sensor_msgs/Range` as a tracer reading: station, and standard uncertainty (m).
    Range(String, f64),
    /// `geometry_msgs/PointStamped` as a tracer reading: the distance of the point from the origin of its frame.
    Distance(String, f64),
    /// `sensor_msgs/Temperature` as a covariate of this name, in °C.
    Temperature(String),
    /// `sensor_msgs/FluidPressure` as a covariate of this name, in hPa.
    Pressure(String),
    /// `sensor_msgs/RelativeHumidity` as a covariate of this name, in per cent.
    Humidity(String),
    /// `std_msgs/Float64` as a covariate of this name, as it is.
    Number(String),
}

/// The instant at which a message came, or why there is none; asked for by those that are stamped so.
type Arrived = Result<Stamp, String>;

/// A standard message that samples of type `M` are made of.
pub(super) trait Makes<M>: RosType {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<M, String>;
}

impl Foreign {
    /// The sample of a message that arrives now, checked as every other one.
    pub(super) fn made_of<M: Message>(&self, message: &impl Makes<M>, clock: &Clock) -> Result<M, String> {
        let sample = message.sample(self, arrived(clock))?;
        sample.validate().map_err(|error| error.to_string())?;
        Ok(sample)
    }

    fn stamp(&self, header: &Header, arrived: Arrived) -> Result<Stamp, String> {
        if !self.is_stamped {
            return arrived;
        }
        let stamp = header.stamp.to_stamp().map_err(|error| error.to_string())?;
        if stamp == Stamp::default() {
            return Err(
                "its stamp is 0, which is none; let its publisher stamp it, or take stamp = \"arrival\"".to_owned()
            );
        }
        Ok(stamp)
    }

    /// Refuses a message of another frame; `may_be_empty` where messages of this kind seldom name one.
    fn check_frame(&self, header: &Header, may_be_empty: bool) -> Result<(), String> {
        let found = header.frame_id.as_str();
        if found == self.frame_id || found.is_empty() && may_be_empty {
            return Ok(());
        }
        Err(format!(
            "it is of frame {found:?}, and {:?} is wanted; take the right topic, or name its frame in frame_id",
            self.frame_id
        ))
    }

    fn machine_frame(&self) -> Result<Text<NAME_CAPACITY>, String> {
        Text::new(&self.machine_frame_id).map_err(|error| format!("frame_id: {error}"))
    }

    fn scale(&self, stamp: Stamp, reading_m: [f64; 3], offset_m: [f64; 3]) -> Result<ScaleReading, String> {
        finite(&reading_m)?;
        let frame_id = self.machine_frame()?;
        Ok(ScaleReading { stamp, reading_m, offset_m, frame_id, ..ScaleReading::default() })
    }

    fn tracer(&self, stamp: Stamp, length_m: f64, station: &str, u_length_m: f64) -> Result<TracerReading, String> {
        finite(&[length_m])?;
        let station = Text::new(station).map_err(|error| format!("station: {error}"))?;
        let frame_id = self.machine_frame()?;
        Ok(TracerReading { stamp, length_m, u_length_m, station, frame_id, ..TracerReading::default() })
    }

    /// A covariate travels as a scale reading without a position. A sensor that has no value now says NaN (or infinity);
    /// then the reading has no covariate either: handed on, so that the value before does not stay in force.
    fn covariate(&self, stamp: Stamp, name: &str, value: f64) -> Result<ScaleReading, String> {
        let mut covariates = Covariates::new();
        if value.is_finite() {
            covariates.push(name, value, 0.0).map_err(|error| error.to_string())?;
        }
        let (reading_m, frame_id) = ([f64::NAN; 3], self.machine_frame()?);
        Ok(ScaleReading { stamp, reading_m, covariates, frame_id, ..ScaleReading::default() })
    }

    fn other(&self) -> String {
        format!("the driver wants {:?} of it", self.message)
    }
}

/// The time now on the clock that the node goes by.
fn arrived(clock: &Clock) -> Arrived {
    match (clock.now_ns(), clock.is_simulated()) {
        (None, true) => {
            Err("use_sim_time is set and no time has come on /clock, so its arrival has no instant; start what \
                             publishes /clock"
                .to_owned())
        }
        (now_ns, _) => {
            let stamp = now_ns.and_then(|now_ns| Stamp::from_nanos(i64::try_from(now_ns).ok()?).ok());
            stamp.ok_or_else(|| "the clock is outside what a stamp can hold; set it".to_owned())
        }
    }
}

fn finite(values: &[f64]) -> Result<(), String> {
    let found = values.iter().find(|value| !value.is_finite());
    found.map_or(Ok(()), |value| Err(format!("it holds {value}, which is no measured number")))
}

impl Makes<ScaleReading> for JointState {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<ScaleReading, String> {
        let ForeignMessage::Joints(joints, offset_m) = &foreign.message else { return Err(foreign.other()) };
        foreign.check_frame(&self.header, true)?;
        if self.position.len() != self.name.len() {
            return Err(format!("it has {} names and {} positions", self.name.len(), self.position.len()));
        }
        let mut reading_m = [0.0; 3];
        for (joint, value_m) in joints.iter().zip(&mut reading_m) {
            let mut of_name = self.name.iter().zip(&self.position).filter(|(name, _)| *name == joint);
            let seen = || self.name.join(", ");
            *value_m = match (of_name.next(), of_name.next()) {
                (Some((_, position_m)), None) => *position_m,
                (Some(_), Some(_)) => return Err(format!("it has joint {joint:?} twice; it names {}", seen())),
                (None, _) => return Err(format!("it has no joint {joint:?}; it names {}", seen())),
            };
        }
        foreign.scale(foreign.stamp(&self.header, arrived)?, reading_m, *offset_m)
    }
}

impl Makes<ScaleReading> for PointStamped {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<ScaleReading, String> {
        let ForeignMessage::Position(offset_m) = &foreign.message else { return Err(foreign.other()) };
        foreign.check_frame(&self.header, false)?;
        let reading_m = [self.point.x, self.point.y, self.point.z];
        foreign.scale(foreign.stamp(&self.header, arrived)?, reading_m, *offset_m)
    }
}

impl Makes<TracerReading> for PointStamped {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<TracerReading, String> {
        let ForeignMessage::Distance(station, u_m) = &foreign.message else { return Err(foreign.other()) };
        foreign.check_frame(&self.header, false)?;
        finite(&[self.point.x, self.point.y, self.point.z])?;
        let length_m = self.point.x.hypot(self.point.y).hypot(self.point.z);
        foreign.tracer(foreign.stamp(&self.header, arrived)?, length_m, station, *u_m)
    }
}

impl Makes<TracerReading> for Range {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<TracerReading, String> {
        let ForeignMessage::Range(station, u_m) = &foreign.message else { return Err(foreign.other()) };
        foreign.check_frame(&self.header, false)?;
        finite(&[f64::from(self.range)])?;
        let (lowest_m, highest_m) = (self.min_range, self.max_range);
        // Where both are 0, they were left out.
        if (lowest_m, highest_m) != (0.0, 0.0) && !(lowest_m..=highest_m).contains(&self.range) {
            return Err(format!("its range of {} m is outside its own {lowest_m} m to {highest_m} m", self.range));
        }
        let length_m = f64::from(self.range);
        let rounding_m = HALF_DIGIT * length_m.abs() / 3.0_f64.sqrt();
        foreign.tracer(foreign.stamp(&self.header, arrived)?, length_m, station, u_m.hypot(rounding_m))
    }
}

impl Makes<ScaleReading> for Temperature {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<ScaleReading, String> {
        let ForeignMessage::Temperature(name) = &foreign.message else { return Err(foreign.other()) };
        if self.temperature.is_finite() && self.temperature < ABSOLUTE_ZERO_C {
            return Err(format!("{} °C is below absolute zero", self.temperature));
        }
        foreign.covariate(foreign.stamp(&self.header, arrived)?, name, self.temperature)
    }
}

impl Makes<ScaleReading> for FluidPressure {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<ScaleReading, String> {
        let ForeignMessage::Pressure(name) = &foreign.message else { return Err(foreign.other()) };
        if self.fluid_pressure.is_finite() && self.fluid_pressure < 0.0 {
            return Err(format!("{} Pa is below vacuum", self.fluid_pressure));
        }
        foreign.covariate(foreign.stamp(&self.header, arrived)?, name, self.fluid_pressure / 100.0)
    }
}

impl Makes<ScaleReading> for RelativeHumidity {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<ScaleReading, String> {
        let ForeignMessage::Humidity(name) = &foreign.message else { return Err(foreign.other()) };
        if self.relative_humidity.is_finite() && !(0.0..=1.0).contains(&self.relative_humidity) {
            return Err(format!(
                "a relative humidity of {} is not from 0 to 1; per cent are not meant",
                self.relative_humidity
            ));
        }
        foreign.covariate(foreign.stamp(&self.header, arrived)?, name, self.relative_humidity * 100.0)
    }
}

impl Makes<ScaleReading> for Float64 {
    fn sample(&self, foreign: &Foreign, arrived: Arrived) -> Result<ScaleReading, String> {
        let ForeignMessage::Number(name) = &foreign.message else { return Err(foreign.other()) };
        foreign.covariate(arrived?, name, self.data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::standard::Point;

    fn foreign(message: ForeignMessage) -> Foreign {
        let (frame_id, machine_frame_id) = ("tracer".to_owned(), "bridge".to_owned());
        Foreign { message, frame_id, machine_frame_id, is_stamped: true }
    }

    fn header() -> Header {
        Header::new(Stamp::new(7, 0).unwrap(), "tracer")
    }

    fn why<M: Message>(outcome: Result<M, String>) -> String {
        outcome.unwrap_err()
    }

    #[test]
    fn units_are_those_of_the_message_and_impossible_values_are_refused() {
        let value = |outcome: Result<ScaleReading, String>| outcome.unwrap().covariates.iter().next().unwrap().value;
        let humidity = foreign(ForeignMessage::Humidity("humidity_pct".to_owned()));
        let message = |relative_humidity| RelativeHumidity { header: header(), relative_humidity, variance: 0.0 };
        assert_eq!(value(humidity.made_of(&message(0.45), &Clock::of_system())), 45.0);
        assert!(why::<ScaleReading>(humidity.made_of(&message(45.0), &Clock::of_system())).contains("not from 0 to 1"));
        let pressure = foreign(ForeignMessage::Pressure("pressure_hpa".to_owned()));
        let message = |fluid_pressure| FluidPressure { header: header(), fluid_pressure, variance: 0.0 };
        assert_eq!(value(pressure.made_of(&message(101_325.0), &Clock::of_system())), 1013.25);
        assert!(why::<ScaleReading>(pressure.made_of(&message(-1.0), &Clock::of_system())).contains("vacuum"));
        let air = foreign(ForeignMessage::Temperature("temp_air_c".to_owned()));
        let message = |temperature| Temperature { header: header(), temperature, variance: 0.0 };
        assert!(why::<ScaleReading>(air.made_of(&message(-300.0), &Clock::of_system())).contains("absolute zero"));
    }

    #[test]
    fn regress_a_sensor_that_says_nan_is_handed_on_as_one_without_a_value() {
        let clock = Clock::of_system();
        for none in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let air = foreign(ForeignMessage::Temperature("temp_air_c".to_owned()));
            let air = air.made_of(&Temperature { header: header(), temperature: none, variance: 0.0 }, &clock);
            let pressure = foreign(ForeignMessage::Pressure("pressure_hpa".to_owned()));
            let pressure =
                pressure.made_of(&FluidPressure { header: header(), fluid_pressure: none, variance: 0.0 }, &clock);
            let humidity = foreign(ForeignMessage::Humidity("humidity_pct".to_owned()));
            let humidity = humidity
                .made_of(&RelativeHumidity { header: header(), relative_humidity: none, variance: 0.0 }, &clock);
            for said in [air, pressure, humidity] {
                let said: ScaleReading = said.unwrap();
                assert_eq!((said.stamp, said.covariates.iter().count()), (Stamp::new(7, 0).unwrap(), 0), "{none}");
            }
            let number = Foreign { is_stamped: false, ..foreign(ForeignMessage::Number("temp_air_c".to_owned())) };
            let said: ScaleReading = number.made_of(&Float64 { data: none }, &clock).unwrap();
            assert_eq!(said.covariates.iter().count(), 0, "{none}");
        }
    }

    #[test]
    fn a_distance_is_that_of_the_point_in_the_frame_of_its_instrument() {
        let distance = foreign(ForeignMessage::Distance("S1".to_owned(), 1e-6));
        let point = |header| PointStamped { header, point: Point { x: 2.0, y: -3.0, z: 6.0 } };
        let reading: TracerReading = distance.made_of(&point(header()), &Clock::simulated()).unwrap();
        assert_eq!((reading.length_m, reading.u_length_m, reading.station.as_str()), (7.0, 1e-6, "S1"));
        assert_eq!((reading.frame_id.as_str(), reading.stamp), ("bridge", Stamp::new(7, 0).unwrap()));
        let elsewhere = Header { frame_id: "other".to_owned(), ..header() };
        assert!(why::<TracerReading>(distance.made_of(&point(elsewhere), &Clock::of_system())).contains("\"other\""));
        let unstamped = Header { stamp: abbe_msgs::standard::Time::default(), ..header() };
        assert!(
            why::<TracerReading>(distance.made_of(&point(unstamped.clone()), &Clock::of_system())).contains("arrival")
        );
        // By arrival no stamp is asked for.
        let arriving = Foreign { is_stamped: false, ..distance };
        let reading: TracerReading = arriving.made_of(&point(unstamped), &Clock::of_system()).unwrap();
        assert!(reading.stamp.sec() > 1_600_000_000);
    }

    #[test]
    fn a_covariate_arrives_by_simulated_time_once_there_is_one() {
        let number = foreign(ForeignMessage::Number("temp_air_c".to_owned()));
        let by = |clock: &Clock| number.made_of::<ScaleReading>(&Float64 { data: 20.5 }, clock);
        let clock = Clock::simulated();
        assert!(why(by(&clock)).contains("/clock"), "no time has come yet, and the host's is another one");
        clock.set(7_000_000_005);
        assert_eq!(by(&clock).unwrap().stamp, Stamp::new(7, 5).unwrap());
    }
}
