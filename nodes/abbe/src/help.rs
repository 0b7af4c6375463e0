//! Help: commands grouped by job, an example for each, options by topic; the version with the commit.
//!
//! Place in the flow: around clap in `main`; completions and manual pages are made of the same description. Every command
//! has a line in `JOBS`; a test holds that, and that each example is one that the program takes.

use crate::Arguments;
use clap::{Arg, Command, CommandFactory, FromArgMatches};
use std::fmt::Write;

/// Version and commit.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("ABBE_BUILD"), ")");

/// Commands that serve one job.
struct Job {
    title: &'static str,
    /// Name of each command, and an example of it.
    commands: &'static [(&'static str, &'static str)],
}

/// All commands that are shown, by job.
const JOBS: [Job; 7] = [
    Job {
        title: "Measure",
        commands: &[
            ("plan", "abbe plan --machine machine.toml --request request.toml --out plan"),
            ("capture", "abbe capture capture.toml --out captured"),
            ("simulate", "abbe simulate --machine machine.toml --seed 1 --out practice"),
            ("points", "abbe points --machine machine.toml --campaign campaign.csv --out vectors.csv"),
            ("sphere", "abbe sphere --points sphere.csv --radius-mm 12.5"),
            ("probe-pose", "abbe probe-pose --centres centres.csv --out pose"),
            ("guideway", "abbe guideway --points targets.csv --axis x --out guideway"),
        ],
    },
    Job {
        title: "Identify",
        commands: &[
            ("identify", "abbe identify --machine machine.toml --campaign campaign.csv --out model.json"),
            ("fit-points", "abbe fit-points --machine machine.toml --points positions.csv --out model.json"),
        ],
    },
    Job {
        title: "Correct",
        commands: &[
            ("correct", "abbe correct --model model.json --in readings.csv --out corrected.csv"),
            ("predict", "abbe predict --model residual.json --in points.csv --out predicted.csv"),
            ("export", "abbe export --model model.json --format csv --out tables.csv"),
        ],
    },
    Job {
        title: "Understand",
        commands: &[
            ("diagnose", "abbe diagnose --model model.json --campaign campaign.csv --out diagnosis"),
            ("volumetric", "abbe volumetric --model model.json --out map"),
            ("residuals", "abbe residuals --model model.json --campaign campaign.csv --out residuals.csv"),
            ("train", "abbe train --residuals residuals.csv --out residual.json"),
            ("compare", "abbe compare --residuals residuals.csv"),
            ("interpolate", "abbe interpolate --vectors vectors.csv --at points.csv --out errors.csv"),
        ],
    },
    Job {
        title: "Check",
        commands: &[
            ("verify", "abbe verify --model model.json --points known.csv"),
            ("conformity", "abbe conformity --runs runs.csv --out figures"),
            ("replay", "abbe replay --bag recorded --model model.json"),
            ("papers", "abbe papers --effort 0.02 --out papers"),
        ],
    },
    Job {
        title: "Live",
        commands: &[
            ("demo", "abbe demo --out demo"),
            ("launch", "abbe launch launch.toml"),
            ("proxy", "abbe proxy --listen 127.0.0.1:1294 --to cmm:1294 --model model.json --tool Probe1=0,0,-120"),
            ("node", "abbe node monitor --launch launch.toml --ros-args --log-level info"),
        ],
    },
    Job {
        title: "Files",
        commands: &[
            ("convert", "abbe convert --machine machine.toml --campaign campaign.csv --out bag"),
            ("recover", "abbe recover --bag damaged --out whole"),
            ("completions", "abbe completions bash > ~/.local/share/bash-completion/completions/abbe"),
            ("man", "abbe man --out ~/.local/share/man/man1"),
        ],
    },
];

const INPUT: &str = "What goes in";
const OUTPUT: &str = "What comes out";
const OF_A_BAG: &str = "Bags";
const OF_WHO: &str = "Who measured, for the report";
const CHOICES: &str = "Choices";

/// Options that name what is read.
const INPUTS: [&str; 24] = [
    "machine",
    "request",
    "plan",
    "campaign",
    "model",
    "residual",
    "residuals",
    "input",
    "points",
    "verify",
    "bag",
    "lengths",
    "sphere",
    "runs",
    "centres",
    "vectors",
    "at",
    "launch",
    "config",
    "paper",
    "resume",
    "listen",
    "tracer_listen",
    "to",
];
/// Options that name what is written.
const OUTPUTS: [&str; 8] = ["out", "output", "json", "format", "record", "html", "pdf", "dcc"];
/// Options about how a bag is read or written.
const BAGS: [&str; 3] = ["match_within_s", "max_covariate_age_s", "namespace"];

/// Options about who measured, when and with what.
const WHO: [&str; 3] = ["identity", "operator", "measured"];

/// Topic of an option.
fn topic(id: &str) -> &'static str {
    match id {
        id if INPUTS.contains(&id) => INPUT,
        id if OUTPUTS.contains(&id) => OUTPUT,
        id if BAGS.contains(&id) => OF_A_BAG,
        id if WHO.contains(&id) => OF_WHO,
        _ => CHOICES,
    }
}

fn by_topic(option: Arg) -> Arg {
    let own = option.is_positional() || matches!(option.get_id().as_str(), "help" | "version");
    if own {
        option
    } else {
        let topic = topic(option.get_id().as_str());
        option.help_heading(topic)
    }
}

/// Example of a command.
fn example(name: &str) -> Option<&'static str> {
    let all = JOBS.iter().flat_map(|job| job.commands);
    all.into_iter().find(|(command, _)| *command == name).map(|(_, example)| *example)
}

/// A program whose commands have their options by topic, and an example.
pub fn with_examples(program: Command) -> Command {
    program.mut_subcommands(|command| {
        let example = example(command.get_name());
        let command = command.mut_args(by_topic);
        match example {
            Some(example) => command.after_help(format!("Example:\n  {example}")),
            None => command,
        }
    })
}

/// The program as clap describes it, with everything above.
pub(crate) fn command() -> Command {
    let command = with_examples(Arguments::command());
    let listed = listed(&command);
    command.help_template(format!(
        "{{about}}\n\n{{usage-heading}} {{usage}}\n\n{listed}Options:\n{{options}}\n\nabbe COMMAND --help says more of each, with an example.\n"
    ))
}

/// All commands by job, a line each.
fn listed(command: &Command) -> String {
    let width = JOBS.iter().flat_map(|job| job.commands).map(|(name, _)| name.len()).max().unwrap_or(0);
    let about = |name: &str| command.find_subcommand(name).and_then(|c| c.get_about()).map(ToString::to_string);
    let mut text = String::new();
    for Job { title, commands } in &JOBS {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{title}:");
        for (name, _) in *commands {
            let _ = writeln!(text, "  {name:<width$}  {}", about(name).unwrap_or_default());
        }
        text.push('\n');
    }
    text
}

/// Takes the command line; ends the program with words where it is not one, or asks for help.
pub(crate) fn parse(words: Vec<String>) -> Arguments {
    let mut matches = command().get_matches_from(words);
    Arguments::from_arg_matches_mut(&mut matches).unwrap_or_else(|error| error.format(&mut command()).exit())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_command_stands_once_in_a_job_with_an_example_that_the_program_takes() {
        let command = command();
        let shown: BTreeSet<&str> =
            command.get_subcommands().filter(|c| !c.is_hide_set()).map(Command::get_name).collect();
        let in_jobs: Vec<&str> = JOBS.iter().flat_map(|job| job.commands).map(|(name, _)| *name).collect();
        assert_eq!(in_jobs.len(), shown.len(), "one line each: {in_jobs:?}");
        assert_eq!(in_jobs.into_iter().collect::<BTreeSet<_>>(), shown, "a line in JOBS for each command");
        for (name, example) in JOBS.iter().flat_map(|job| job.commands) {
            let own = example.split(" --ros-args").next().unwrap().split(" >").next().unwrap();
            let words: Vec<&str> = own.split(' ').collect();
            assert_eq!(words[..2], ["abbe", name]);
            super::command().try_get_matches_from(words).unwrap_or_else(|error| panic!("{example}: {error}"));
        }
    }

    #[test]
    fn an_option_that_must_be_given_is_what_goes_in_or_comes_out() {
        for command in command().get_subcommands() {
            for option in command.get_arguments().filter(|option| option.is_required_set() && !option.is_positional()) {
                let heading = option.get_help_heading();
                let name = (command.get_name(), option.get_id());
                let of_choice = matches!(name.0, "simulate") && name.1 == "seed" || name.0 == "guideway";
                assert!(matches!(heading, Some(INPUT | OUTPUT)) || of_choice, "{name:?}: {heading:?}");
            }
        }
    }

    #[test]
    fn the_version_names_the_commit_or_says_that_it_is_not_known() {
        assert!(VERSION.starts_with(env!("CARGO_PKG_VERSION")) && VERSION.contains("commit"), "{VERSION}");
    }
}
