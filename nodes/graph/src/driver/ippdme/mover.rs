//! Moving the machine that the driver reads: orders in, what became of them out. Nothing moves that nobody ordered.
//!
//! Place in the flow: [`crate::capture`] orders, the driver's thread obeys between two questions for the position. An order to move is
//! bound to the session in which the machine was made ready; one of another session is refused, so that a connection that
//! came back moves nothing by itself. A move has to come to where it was ordered. Positions of the scales in machine
//! coordinates (m); the tip's on the wire (mm).

use super::client::{Client, Moved, Stop};
use super::session::{Talk, items_of, numbers};
use abbe_ippdme::item::Item;
use abbe_ippdme::trouble::Trouble;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

/// Offsets this near are the same (m).
const SAME_OFFSET_M: f64 = 1e-6;
/// A speed that the server took differs by this share at most.
const SAME_SPEED: f64 = 1e-3;
/// Connections that differ are told apart by this.
pub type SessionNumber = u64;

/// What is ordered.
#[derive(Debug, Clone, PartialEq)]
pub enum Order {
    /// Look whether the machine may be moved, and set its speed (m/s) and the bounds (m) that it must stand within.
    Ready {
        /// Speed (m/s).
        speed_m_s: f64,
        /// Lowest and highest reading of each axis (m).
        stroke_m: [(f64, f64); 3],
    },
    /// Move in a straight line.
    Go {
        /// The session in which it was ready.
        session: SessionNumber,
        /// Where the scales shall read this (m).
        reading_m: [f64; 3],
        /// The offset that the tip must have (m); `None` where the driver's does not matter.
        offset_m: Option<[f64; 3]>,
        /// How far from it the machine may come to stand (m).
        within_m: f64,
    },
}

/// What became of an order.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The machine may be moved in this session, and stands here (m).
    Ready(SessionNumber, [f64; 3]),
    /// It has come to where it was ordered.
    Arrived,
    /// It did not move, for this reason; who orders has to ask anew.
    Refused(String),
    /// The connection was lost; it may have moved.
    Lost(String),
    /// It moved, or may have, and was stopped: by an error of the server, on request, or because it came to another place.
    Stopped(String),
}

/// The orderer's end.
#[derive(Debug)]
pub struct Mover {
    orders: SyncSender<Order>,
    outcomes: Receiver<Outcome>,
    is_aborted: Arc<AtomicBool>,
}

impl Mover {
    /// Orders; `false` where the driver is gone or has an order already.
    pub fn order(&self, order: Order) -> bool {
        self.orders.try_send(order).is_ok()
    }

    /// What became of the order, once it is known.
    pub fn outcome(&self) -> Option<Outcome> {
        match self.outcomes.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Outcome::Stopped("the driver has ended".to_owned())),
        }
    }

    /// Stops the move that is under way (`AbortE`).
    pub fn abort(&self) {
        self.is_aborted.store(true, Ordering::Relaxed);
    }
}

/// The driver's end.
#[derive(Debug)]
pub(super) struct Obeying {
    orders: Receiver<Order>,
    outcomes: SyncSender<Outcome>,
    is_aborted: Arc<AtomicBool>,
    /// Counts sessions that were begun.
    pub(super) session: SessionNumber,
    /// The session in which the machine was found ready.
    ready: Option<SessionNumber>,
}

/// Both ends.
pub(super) fn pair() -> (Mover, Obeying) {
    // An outcome for each order, and one order at a time.
    let ((give, orders), (tell, outcomes)) = (sync_channel(1), sync_channel(2));
    let is_aborted = Arc::new(AtomicBool::new(false));
    let mover = Mover { orders: give, outcomes, is_aborted: Arc::clone(&is_aborted) };
    (mover, Obeying { orders, outcomes: tell, is_aborted, session: 0, ready: None })
}

impl Talk {
    /// Obeys the order that waits, if there is one.
    pub(super) fn obey(&mut self, client: &mut Client) -> Result<(), Stop> {
        let Ok(order) = self.obeying.orders.try_recv() else { return Ok(()) };
        let (outcome, stop) = match order {
            Order::Ready { speed_m_s, stroke_m } => match self.make_ready(client, speed_m_s, &stroke_m) {
                Ok(Ok(at_m)) => {
                    self.obeying.ready = Some(self.obeying.session);
                    (Outcome::Ready(self.obeying.session, at_m), None)
                }
                Ok(Err(why)) => (Outcome::Refused(why), None),
                Err(stop) => (Outcome::Refused(words(&stop)), Some(stop)),
            },
            Order::Go { session, .. } if self.obeying.ready != Some(session) || session != self.obeying.session => {
                (Outcome::Refused("the session with the server is another one than before".to_owned()), None)
            }
            Order::Go { reading_m, offset_m, within_m, .. } => match self.may_go(client, offset_m) {
                Err(stop) => (Outcome::Refused(words(&stop)), Some(stop)),
                Ok(Err(why)) => (Outcome::Refused(why), None),
                Ok(Ok(own_m)) => self.go(client, &reading_m, &own_m, within_m),
            },
        };
        // Who ordered may have ended.
        let _ = self.obeying.outcomes.try_send(outcome);
        stop.map_or(Ok(()), Err)
    }

    /// Looks at all that can be asked for before a machine is moved; where it stands, or why it must not move.
    fn make_ready(
        &mut self,
        client: &mut Client,
        speed_m_s: f64,
        stroke_m: &[(f64, f64); 3],
    ) -> Result<Result<[f64; 3], String>, Stop> {
        let number = |items: &[Item], name: &str| items.iter().find_map(|item| Some(item.number_of(name)?.0));
        if number(&items_of(&client.ask("GetErrStatusE()")?), "ErrStatus") != Some(0.0) {
            return Ok(Err("the server has an error that is not cleared; clear it at the machine".to_owned()));
        }
        if number(&items_of(&client.ask("IsHomed()")?), "IsHomed") != Some(1.0) {
            return Ok(Err("the machine is not homed; home it at its panel".to_owned()));
        }
        // What the server took for the speed is asked for: a machine must not go faster than was stated.
        let speed_mm_s = speed_m_s * 1e3;
        client.ask(&format!("SetProp(Tool.GoToPar.Speed({speed_mm_s:?}))"))?;
        let told = numbers(&client.ask("GetProp(Tool.GoToPar.Speed())")?);
        match told.as_deref() {
            Some([took]) if (took - speed_mm_s).abs() <= SAME_SPEED * speed_mm_s => {}
            Some([took]) => {
                return Ok(Err(format!(
                    "the server took {took} mm/s for the speed of {speed_mm_s} mm/s; state one that it can do"
                )));
            }
            _ => return Ok(Err("the server does not tell the speed that it took (Tool.GoToPar.Speed)".to_owned())),
        }
        self.ask_tool_and_covariates(client)?;
        let Some(tip_m) = self.tip_m(client)? else {
            return Ok(Err("the server does not tell where the machine stands".to_owned()));
        };
        // The tool that the position was told with.
        self.take_before(client, u64::MAX)?;
        let offset_m = match &self.tool {
            Ok(offset_m) => *offset_m,
            Err(why) => return Ok(Err(why.clone())),
        };
        let at_m: [f64; 3] = std::array::from_fn(|d| tip_m[d] - offset_m[d]);
        for (d, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
            let (low_m, high_m) = stroke_m[d];
            if !(low_m..=high_m).contains(&at_m[d]) {
                return Ok(Err(format!(
                    "the machine stands at {axis} = {:.3} mm, outside of {:.3} to {:.3} mm of the machine file; see that unit, frame \
                     and offset of the tool are right, or move it inside by hand",
                    at_m[d] * 1e3,
                    low_m * 1e3,
                    high_m * 1e3
                )));
            }
        }
        Ok(Ok(at_m))
    }

    /// The offset of the tip (m), or why the machine must not move.
    fn may_go(&mut self, client: &mut Client, wanted_m: Option<[f64; 3]>) -> Result<Result<[f64; 3], String>, Stop> {
        // What the server says of its tool is heard first.
        client.hear()?;
        self.take_before(client, u64::MAX)?;
        if self.is_tool_new || self.tool.is_err() {
            self.ask_tool_and_covariates(client)?;
        }
        Ok(self.tool.clone().and_then(|own_m| match wanted_m {
            Some(wanted_m) if (0..3).any(|d| (own_m[d] - wanted_m[d]).abs() > SAME_OFFSET_M) => Err(format!(
                "the tip sits at offset {:?} mm, and the plan wants {:?} mm; change the tool",
                own_m.map(|m| m * 1e3),
                wanted_m.map(|m| m * 1e3)
            )),
            _ => Ok(own_m),
        }))
    }

    /// Moves, waits as long as it takes, and looks where the machine has come to.
    fn go(
        &mut self,
        client: &mut Client,
        reading_m: &[f64; 3],
        offset_m: &[f64; 3],
        within_m: f64,
    ) -> (Outcome, Option<Stop>) {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|d| (reading_m[d] + offset_m[d]) * 1e3);
        let aborted = Arc::clone(&self.obeying.is_aborted);
        let command = format!("GoTo(X({x:.6}), Y({y:.6}), Z({z:.6}))");
        match client.move_by(&command, &|| aborted.load(Ordering::Relaxed)) {
            Ok(Moved::Whole) => {}
            Ok(Moved::Aborted) => {
                return (Outcome::Stopped("the move was aborted on request".to_owned()), Some(Stop::Gone));
            }
            // What stopped a move is for somebody at the machine to look at; it is not cleared from here.
            Err(stop @ Stop::Trouble(..)) => return (Outcome::Stopped(words(&stop)), Some(Stop::Gone)),
            Err(stop) => return (Outcome::Lost(words(&stop)), Some(stop)),
        }
        let ordered_m = [x, y, z].map(|mm| mm / 1e3);
        let square_m2 = |tip_m: [f64; 3]| ordered_m.iter().zip(tip_m).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        match self.tip_m(client).map(|tip_m| tip_m.map(square_m2)) {
            Ok(Some(square_m2)) if square_m2.sqrt() <= within_m => (Outcome::Arrived, None),
            Ok(Some(square_m2)) => {
                let away_mm = square_m2.sqrt() * 1e3;
                self.obeying.ready = None;
                (
                    Outcome::Stopped(format!(
                        "the server says that it has arrived, and it stands {away_mm:.3} mm away"
                    )),
                    None,
                )
            }
            Ok(None) => (Outcome::Stopped("the server does not tell where it has come to".to_owned()), None),
            Err(stop) => (Outcome::Lost(words(&stop)), Some(stop)),
        }
    }

    /// Where the tip is (m).
    fn tip_m(&mut self, client: &mut Client) -> Result<Option<[f64; 3]>, Stop> {
        let items = items_of(&client.ask("Get(X(), Y(), Z())")?);
        let axis = |name: &str| items.iter().find_map(|item| Some(item.number_of(name)?.0 / 1e3));
        Ok(axis("X").zip(axis("Y")).zip(axis("Z")).map(|((x, y), z)| [x, y, z]))
    }
}

fn words(stop: &Stop) -> String {
    match stop {
        Stop::Gone => "the capture was ended".to_owned(),
        Stop::Lost(why) => format!("the connection was lost: {why}"),
        Stop::Trouble(trouble, _) => Trouble::to_string(trouble),
    }
}
