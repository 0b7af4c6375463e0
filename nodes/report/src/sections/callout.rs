//! A sentence set apart: note, good news, warning or failure, always said in words too.

use serde::{Deserialize, Serialize};

use crate::text::{capital, escape, prose};

/// How a figure or a sentence is to be taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tone {
    /// Plain information.
    #[default]
    Neutral,
    /// As it should be.
    Good,
    /// Needs attention.
    Warning,
    /// Not as it should be.
    Bad,
}

impl Tone {
    /// Style class; empty for plain information.
    pub(crate) fn class(self) -> &'static str {
        match self {
            Self::Neutral => "",
            Self::Good => " good",
            Self::Warning => " warning",
            Self::Bad => " bad",
        }
    }

    /// The tone in words, so that it does not hang on a colour.
    pub fn word(self) -> &'static str {
        match self {
            Self::Neutral => "Note",
            Self::Good => "In order",
            Self::Warning => "Warning",
            Self::Bad => "Failed",
        }
    }
}

/// A sentence set apart.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Callout {
    /// How it is to be taken.
    pub tone: Tone,
    /// Short title; may be empty.
    pub title: String,
    /// The text.
    pub text: String,
}

impl Callout {
    /// The text as a sentence, with its full stop: what was written to follow a file's name begins small.
    pub(crate) fn sentence(&self) -> String {
        let first = self.text.split(' ').next().unwrap_or_default().trim_end_matches(['.', ',', ';']);
        let is_word = first != "abbe" && first.chars().all(|c| c.is_ascii_lowercase());
        let text = if is_word { capital(&prose(&self.text)) } else { prose(&self.text) };
        if text.is_empty() || text.ends_with(['.', '!', '?', ':']) { text } else { text + "." }
    }

    /// HTML of the callout.
    pub(crate) fn html(&self) -> String {
        let title = if self.title.is_empty() { String::new() } else { format!(" — {}", escape(&prose(&self.title))) };
        format!(
            "<div class=\"callout{}\"><p><b>{}{title}.</b> {}</p></div>\n",
            self.tone.class(),
            self.tone.word(),
            escape(&self.sentence())
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_text_of_one_word_begins_large_as_others_do_and_a_file_keeps_its_name() {
        let said = |text: &str| Callout { tone: Tone::Good, title: String::new(), text: text.to_owned() }.sentence();
        assert_eq!(said("conforms. Decision rule: none."), "Conforms. Decision rule: none.");
        assert_eq!(said("conforms; it uses 64 %"), "Conforms; it uses 64 %.");
        assert_eq!(said("runs.csv: 3 rows"), "runs.csv: 3 rows.");
        assert_eq!(said("abbe diagnose finds it"), "abbe diagnose finds it.");
    }
}
