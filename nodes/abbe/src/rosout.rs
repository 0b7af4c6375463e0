//! Lines of the log for `/rosout`, beside those on standard error.
//!
//! Place in the flow: under every command; where a node of this process is in the ROS graph, its gateway publishes them.

use abbe_msgs::standard::Log;
use abbe_runtime::{LogLine, tell_log_line};
use std::fmt::{self, Write};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

/// Hands every line over.
pub(crate) struct Rosout;

impl<S: Subscriber> Layer<S> for Rosout {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        let level = match *metadata.level() {
            Level::ERROR => Log::ERROR,
            Level::WARN => Log::WARN,
            Level::INFO => Log::INFO,
            Level::DEBUG | Level::TRACE => Log::DEBUG,
        };
        let mut text = Text::default();
        event.record(&mut text);
        let file = metadata.file().unwrap_or_default().to_owned();
        tell_log_line(LogLine { level, text: text.0, file, line: metadata.line().unwrap_or_default() });
    }
}

/// What an event says: the message, then each further field by its name.
#[derive(Default)]
struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing to a String cannot fail.
        let _ = match field.name() {
            "message" => {
                let fields = std::mem::take(&mut self.0);
                write!(self.0, "{value:?}{}{fields}", if fields.is_empty() { "" } else { " " })
            }
            name => write!(self.0, "{}{name}={value:?}", if self.0.is_empty() { "" } else { " " }),
        };
    }
}
