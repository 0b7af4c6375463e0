//! I++ DME, the protocol by which measuring software talks to the controllers of coordinate measuring machines.
//!
//! Place in the flow: the driver `ippdme` reads a controller with it, `abbe proxy` stands between software and controller.
//! Lines and their parts ([`mod@line`], [`item`], [`message`]), what errors ask for ([`trouble`]), coordinate systems ([`csy`]), and
//! the [`relay`] that corrects what passes. No clock and no socket: bytes in, bytes out. Written after version 1.4.3 of the
//! specification; lengths on the wire are millimetres, angles degrees.

pub mod csy;
pub mod item;
pub mod line;
pub mod message;
pub mod number;
pub mod relay;
pub mod server;
pub mod trouble;
