//! The transport over Zenoh in a program that is built without it: nothing of it can be opened.
//!
//! Place in the flow: in place of everything else here, so that nobody who opens endpoints has to ask how the program was
//! built.

use std::convert::Infallible;
use std::marker::PhantomData;
use std::num::NonZeroUsize;
use std::time::Duration;

use abbe_msgs::{Message, RosType};

use crate::ros::{Domain, NodeIdentity};
use crate::transport::shared_memory::SampleOrigin;
use crate::transport::{Publish, Subscribe, TransportError, TransportKind};

/// The configuration of a session, which there is none.
#[derive(Debug, Clone)]
pub struct ZenohConfig(Infallible);

/// A session, which there is none.
#[derive(Debug, Clone)]
pub struct ZenohSession(Infallible);

/// Sends over Zenoh; there is none.
pub struct ZenohPublisher<M: Message>(Infallible, PhantomData<fn(M)>);

/// Receives over Zenoh; there is none.
pub struct ZenohSubscriber<M: Message>(Infallible, PhantomData<fn() -> M>);

/// Publishes messages; there is none.
pub(crate) struct ZenohWriter<R: RosType>(Infallible, PhantomData<fn(R)>);

impl ZenohConfig {
    /// What the environment says.
    ///
    /// # Errors
    /// Always: this program is built without Zenoh.
    pub fn from_environment() -> Result<Self, TransportError> {
        Err(TransportError::NotBuilt { kind: TransportKind::Zenoh })
    }
}

impl ZenohSession {
    /// Opens a session.
    ///
    /// # Errors
    /// There is no configuration to call it with.
    pub fn open(_: &NodeIdentity, _: Domain, config: ZenohConfig) -> Result<Self, TransportError> {
        match config.0 {}
    }

    /// A publisher.
    ///
    /// # Errors
    /// There is no session to call it on.
    pub fn publisher<M: Message>(&self, _: &str, _: NonZeroUsize) -> Result<ZenohPublisher<M>, TransportError> {
        match self.0 {}
    }

    /// A subscriber.
    ///
    /// # Errors
    /// There is no session to call it on.
    pub fn subscriber<M: Message>(&self, _: &str, _: NonZeroUsize) -> Result<ZenohSubscriber<M>, TransportError> {
        match self.0 {}
    }

    pub(crate) fn writer<R: RosType>(&self, _: &str, _: NonZeroUsize) -> Result<ZenohWriter<R>, TransportError> {
        match self.0 {}
    }

    pub(crate) fn publishers_elsewhere(&self, _: &str, _: &str) -> usize {
        match self.0 {}
    }
}

impl<R: RosType> ZenohWriter<R> {
    pub(crate) fn publish(&self, _: &R) -> Result<(), String> {
        match self.0 {}
    }

    pub(crate) fn subscribers(&self) -> usize {
        match self.0 {}
    }
}

impl<M: Message> ZenohSubscriber<M> {
    pub(crate) fn take_with_origin(&mut self, _: Duration) -> Result<Option<(M, SampleOrigin)>, TransportError> {
        match self.0 {}
    }
}

impl<M: Message> Publish<M> for ZenohPublisher<M> {
    fn send(&mut self, _: &M) -> Result<(), TransportError> {
        match self.0 {}
    }

    fn dropped(&self) -> u64 {
        match self.0 {}
    }

    fn subscribers(&self) -> usize {
        match self.0 {}
    }
}

impl<M: Message> Subscribe<M> for ZenohSubscriber<M> {
    fn try_take(&mut self) -> Result<Option<M>, TransportError> {
        match self.0 {}
    }

    fn wait(&mut self, _: Duration) -> Result<bool, TransportError> {
        match self.0 {}
    }

    fn lost(&self) -> u64 {
        match self.0 {}
    }

    fn interleaved(&self) -> u64 {
        match self.0 {}
    }
}
