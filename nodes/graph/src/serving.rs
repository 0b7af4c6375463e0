//! The simulated machine on sockets: an I++ DME or OPC UA server for its scales, lines of text for the tracer.
//!
//! Place in the flow: `abbe simulate --serve`, to rehearse a capture through the drivers that a real machine has. The
//! machine begins to move when a client has begun a session and somebody reads the tracer, and goes its way whoever listens, as a
//! real one does; or it obeys the `GoTo` of a client. Any number of clients may look at once.

use abbe_ippdme::line::{Lines, Piece, text};
use abbe_ippdme::server::{Order, Position, Session};
use abbe_runtime::Shutdown;
use abbe_virtual_machine::{Drive, Obedient, Seen};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// How often a client's thread looks whether there is something to report, or whether to stop.
const LOOK_UP: Duration = Duration::from_millis(20);
/// What is stated of a single length (µm, k = 1): nobody reads it when a campaign is captured.
const U_LENGTH_UM: f64 = 0.2;

/// Why nothing is served over OPC UA.
pub const NO_OPCUA: &str =
    "this program was built without OPC UA; build it with --features opcua, or take that of the package";
/// Axes as OPC UA serves them.
#[cfg(feature = "opcua")]
const OPCUA_AXES: [abbe_opcua::server::Served; 3] = {
    use abbe_opcua::server::Served;
    [Served { name: "X", unit: "_mm" }, Served { name: "Y", unit: "_mm" }, Served { name: "Z", unit: "_mm" }]
};
/// How often these are set.
#[cfg(feature = "opcua")]
const OPCUA_EVERY: Duration = Duration::from_millis(5);

/// Who says where the machine goes.
pub enum Way {
    /// Its plan; whether it begins again at the end.
    Planned(Box<Drive>, bool),
    /// A client, within the strokes (m).
    Ordered(Box<Obedient>, [(f64, f64); 3]),
}

impl Way {
    /// What is seen at this time (s).
    fn at(&mut self, time_s: f64) -> Option<Seen> {
        match self {
            Way::Planned(drive, true) => drive.at(time_s % drive.ends_s().max(1e-9)),
            Way::Planned(drive, false) => drive.at(time_s),
            Way::Ordered(machine, _) => Some(machine.at(time_s)),
        }
    }

    fn station(&self, number: usize) -> &str {
        match self {
            Way::Planned(drive, _) => drive.station(number),
            Way::Ordered(machine, _) => machine.drive().station(number),
        }
    }
}

/// The machine and what its clients are told.
pub struct Served {
    way: Mutex<Way>,
    /// Offsets of the reflector (m) by the names of the holders.
    holders: Vec<(String, [f64; 3])>,
    tracer_every: Duration,
    has_session: AtomicBool,
    has_reader: AtomicBool,
    began: Mutex<Option<Instant>>,
}

impl Served {
    /// A machine that stands at the beginning of its way; the tracer gives so many lengths a second.
    pub fn new(way: Way, offsets_m: &[[f64; 3]], tracer_hz: f64) -> Served {
        let name = |(k, offset_m): (usize, &[f64; 3])| (format!("Holder{}", k + 1), *offset_m);
        Served {
            way: Mutex::new(way),
            holders: offsets_m.iter().enumerate().map(name).collect(),
            tracer_every: Duration::from_secs_f64(1.0 / tracer_hz),
            has_session: AtomicBool::new(false),
            has_reader: AtomicBool::new(false),
            began: Mutex::new(None),
        }
    }

    /// The holders and their offsets (m).
    pub fn holders(&self) -> &[(String, [f64; 3])] {
        &self.holders
    }

    /// What is seen now; and how long the machine has been on its way (s).
    fn now(&self) -> Option<(Seen, f64)> {
        let is_looked_at = self.has_session.load(Ordering::Relaxed) && self.has_reader.load(Ordering::Relaxed);
        let mut began = self.began.lock().unwrap_or_else(PoisonError::into_inner);
        let is_ordered = matches!(*self.way.lock().unwrap_or_else(PoisonError::into_inner), Way::Ordered(..));
        if began.is_none() && (is_looked_at || is_ordered) {
            *began = Some(Instant::now());
        }
        let time_s = began.map_or(0.0, |began| began.elapsed().as_secs_f64());
        let mut way = self.way.lock().unwrap_or_else(PoisonError::into_inner);
        Some((way.at(time_s)?, time_s))
    }

    fn position(&self) -> Option<Position> {
        let (seen, time_s) = self.now()?;
        let holder = self.holders.iter().find(|(_, offset_m)| *offset_m == seen.offset_m);
        let tool = holder.map_or_else(|| "NoTool".to_owned(), |(name, _)| name.clone());
        let mm = |m: [f64; 3]| m.map(|m| m * 1e3);
        Some(Position { time_s, scales_mm: mm(seen.reading_m), tool: (tool, mm(seen.offset_m)) })
    }

    fn length_line(&self) -> Option<String> {
        let (seen, _) = self.now()?;
        let way = self.way.lock().unwrap_or_else(PoisonError::into_inner);
        Some(format!("{},{:.7},{U_LENGTH_UM}\n", way.station(seen.station), seen.length_m? * 1e3))
    }

    /// A client of the server.
    fn session(&self) -> Session {
        let session = Session::new(self.holders.iter().map(|(name, _)| name.clone()).collect());
        match &*self.way.lock().unwrap_or_else(PoisonError::into_inner) {
            Way::Planned(..) => session,
            Way::Ordered(_, stroke_m) => session.obeying(stroke_m.map(|(low_m, high_m)| (low_m * 1e3, high_m * 1e3))),
        }
    }

    /// Does what a client ordered, and tells it when the machine has arrived.
    fn obey(&self, session: &mut Session) -> Vec<String> {
        let Some(at) = self.position() else { return Vec::new() };
        let has_arrived = {
            let mut way = self.way.lock().unwrap_or_else(PoisonError::into_inner);
            let Way::Ordered(machine, _) = &mut *way else { return Vec::new() };
            match session.order() {
                Some(Order::Go { scales_mm, speed_mm_s }) => {
                    machine.go(at.time_s, scales_mm.map(|mm| mm / 1e3), speed_mm_s / 1e3);
                }
                Some(Order::Stop) => machine.stop(at.time_s),
                None => {}
            }
            machine.has_arrived(at.time_s)
        };
        if has_arrived { session.arrived(&at) } else { Vec::new() }
    }
}

/// Serves I++ DME until told to stop.
///
/// # Errors
/// A socket that takes nobody any more.
pub fn serve(
    served: &Arc<Served>,
    (server, tracer): (&TcpListener, &TcpListener),
    shutdown: &Shutdown,
) -> std::io::Result<()> {
    accept(served, (Some(server), tracer), shutdown)
}

/// The `axes` of the driver `opcua` for what [`serve_opcua`] serves; `None` in a program that was built without it.
pub fn opcua_axes() -> Option<String> {
    #[cfg(feature = "opcua")]
    {
        let namespace = abbe_opcua::server::NAMESPACE;
        let node = |name: &str| format!("{}_mm = \"nsu={namespace};s={name}\"", name.to_lowercase());
        Some(format!("axes = {{ {} }}", OPCUA_AXES.map(|axis| node(axis.name)).join(", ")))
    }
    #[cfg(not(feature = "opcua"))]
    None
}

/// Serves nothing: there is no OPC UA in this program.
///
/// # Errors
/// Always.
#[cfg(not(feature = "opcua"))]
pub fn serve_opcua(_: &Arc<Served>, _: (TcpListener, &TcpListener), _: &Shutdown) -> std::io::Result<()> {
    Err(std::io::Error::other(NO_OPCUA))
}

/// Serves OPC UA until told to stop; the machine begins to move when somebody reads the tracer.
///
/// # Errors
/// A socket that takes nobody any more, or a server that cannot be.
#[cfg(feature = "opcua")]
pub fn serve_opcua(
    served: &Arc<Served>,
    (server, tracer): (TcpListener, &TcpListener),
    shutdown: &Shutdown,
) -> std::io::Result<()> {
    served.has_session.store(true, Ordering::Relaxed);
    thread::scope(|scope| {
        let lines = scope.spawn(|| {
            let outcome = accept(served, (None, tracer), shutdown);
            // Without its tracer it is no machine to rehearse with.
            shutdown.request();
            outcome
        });
        let mut values = || match served.position() {
            Some(at) => at.scales_mm.map(Some).to_vec(),
            None => vec![None; OPCUA_AXES.len()],
        };
        let outcome =
            abbe_opcua::server::serve(server, &OPCUA_AXES, OPCUA_EVERY, &mut values, &|| shutdown.requested());
        shutdown.request();
        let lines = lines.join().unwrap_or_else(|_| Err(std::io::Error::other("the tracer's thread ended")));
        outcome.map_err(std::io::Error::other).and(lines)
    })
}

fn accept(
    served: &Arc<Served>,
    (server, tracer): (Option<&TcpListener>, &TcpListener),
    shutdown: &Shutdown,
) -> std::io::Result<()> {
    server.map_or(Ok(()), |server| server.set_nonblocking(true))?;
    tracer.set_nonblocking(true)?;
    while !shutdown.requested() {
        let mut is_idle = true;
        if let Some(stream) = server.map_or(Ok(None), accepted)? {
            let (served, shutdown) = (Arc::clone(served), shutdown.clone());
            // Who leaves has left.
            thread::Builder::new().name("client".into()).spawn(move || drop(talk(&served, stream, &shutdown)))?;
            is_idle = false;
        }
        if let Some(stream) = accepted(tracer)? {
            let (served, shutdown) = (Arc::clone(served), shutdown.clone());
            thread::Builder::new().name("reader".into()).spawn(move || drop(measure(&served, stream, &shutdown)))?;
            is_idle = false;
        }
        if is_idle {
            shutdown.sleep(LOOK_UP);
        }
    }
    Ok(())
}

fn accepted(listener: &TcpListener) -> std::io::Result<Option<TcpStream>> {
    match listener.accept() {
        Ok((stream, _)) => {
            stream.set_nonblocking(false)?;
            stream.set_nodelay(true)?;
            Ok(Some(stream))
        }
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::WouldBlock | ErrorKind::Interrupted | ErrorKind::ConnectionAborted
            ) =>
        {
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// One client of the server.
fn talk(served: &Served, mut stream: TcpStream, shutdown: &Shutdown) -> std::io::Result<()> {
    stream.set_read_timeout(Some(LOOK_UP))?;
    let mut session = served.session();
    let (mut lines, mut bytes) = (Lines::default(), [0; 4096]);
    while !shutdown.requested() {
        let count = match stream.read(&mut bytes) {
            Ok(0) => return Ok(()),
            Ok(count) => count,
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) =>
            {
                0
            }
            Err(error) => return Err(error),
        };
        let mut answers = Vec::new();
        for piece in lines.take(&bytes[..count]) {
            let (Piece::Line(line), Some(at)) = (piece, served.position()) else { continue };
            answers.extend(session.take(text(&line), &at));
            served.has_session.fetch_or(session.is_open(), Ordering::Relaxed);
        }
        answers.extend(served.obey(&mut session));
        answers.extend(served.position().map(|at| session.moved(&at)).unwrap_or_default());
        for answer in answers {
            stream.write_all(format!("{answer}\r\n").as_bytes())?;
        }
    }
    Ok(())
}

/// One reader of the tracer.
fn measure(served: &Served, mut stream: TcpStream, shutdown: &Shutdown) -> std::io::Result<()> {
    stream.write_all(b"station,length_mm,u_length_um\n")?;
    served.has_reader.store(true, Ordering::Relaxed);
    while !shutdown.requested() {
        if let Some(line) = served.length_line() {
            stream.write_all(line.as_bytes())?;
        }
        thread::sleep(served.tracer_every);
    }
    Ok(())
}
