//! Log lines of the library: warnings and errors pass, and the same line not more often than once a minute.
//!
//! Place in the flow: in force on the client's thread alone. A server that is gone is tried again every few seconds, and the library has the
//! same words for it each time.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use tracing::dispatcher::Dispatch;
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};

/// How often the same line passes.
const AGAIN_AFTER: Duration = Duration::from_secs(60);
/// Crates of the library.
const LIBRARY: &str = "opcua";

/// Passes lines on to the log that was in force before.
pub(crate) struct Seldom {
    log: Dispatch,
    /// When a line was passed on, by its place in the source.
    passed: Mutex<BTreeMap<(String, u32), Instant>>,
}

impl Seldom {
    pub(crate) fn new(log: Dispatch) -> Seldom {
        Seldom { log, passed: Mutex::new(BTreeMap::new()) }
    }

    fn is_due(&self, metadata: &Metadata<'_>) -> bool {
        let place = (metadata.target().to_owned(), metadata.line().unwrap_or(0));
        let mut passed = self.passed.lock().unwrap_or_else(PoisonError::into_inner);
        let is_due = passed.get(&place).is_none_or(|at| at.elapsed() >= AGAIN_AFTER);
        if is_due {
            passed.insert(place, Instant::now());
        }
        is_due
    }
}

impl Subscriber for Seldom {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        !metadata.target().starts_with(LIBRARY) || *metadata.level() <= Level::WARN && metadata.is_event()
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let metadata = event.metadata();
        // Handed over as it is: what is logged from in here would be an event within an event.
        if (!metadata.target().starts_with(LIBRARY) || self.is_due(metadata)) && self.log.enabled(metadata) {
            self.log.event(event);
        }
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Debug;
    use std::sync::Arc;
    use tracing::dispatcher::with_default;
    use tracing::field::{Field, Visit};

    /// A line's text.
    struct Words(String);

    impl Visit for Words {
        fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
            if field.name() == "message" {
                self.0 = format!("{value:?}");
            }
        }
    }

    /// Counts what comes.
    #[derive(Default)]
    struct Count(Arc<Mutex<Vec<String>>>);

    impl Subscriber for Count {
        fn enabled(&self, _: &Metadata<'_>) -> bool {
            true
        }
        fn new_span(&self, _: &Attributes<'_>) -> Id {
            Id::from_u64(1)
        }
        fn record(&self, _: &Id, _: &Record<'_>) {}
        fn record_follows_from(&self, _: &Id, _: &Id) {}
        fn event(&self, event: &Event<'_>) {
            let mut words = Words(String::new());
            event.record(&mut words);
            self.0.lock().unwrap().push(words.0);
        }
        fn enter(&self, _: &Id) {}
        fn exit(&self, _: &Id) {}
    }

    #[test]
    fn the_same_line_passes_once_a_minute_and_chatter_never() {
        let lines = Arc::new(Mutex::new(Vec::new()));
        let seldom = Seldom::new(Dispatch::new(Count(Arc::clone(&lines))));
        with_default(&Dispatch::new(seldom), || {
            for k in 0..100 {
                tracing::error!(target: "opcua_client::transport", "not reached, try {k}");
                tracing::info!(target: "opcua_client::transport", "sent");
                if k < 2 {
                    tracing::info!(target: "abbe_opcua", "own lines pass");
                }
            }
            tracing::warn!(target: "opcua_client::transport", "another");
        });
        assert_eq!(*lines.lock().unwrap(), ["not reached, try 0", "own lines pass", "own lines pass", "another"]);
    }
}
