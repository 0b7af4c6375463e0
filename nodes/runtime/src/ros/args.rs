//! `--ros-args`: remapping, parameters and parameter files, as every ROS 2 node takes them.
//!
//! Place in the flow: [`RosArgs::split`] takes them off the command line before the node's own
//! arguments are parsed. Nothing is ignored: what is not understood is refused. As in ROS 2 a rule for a node's name goes by the
//! name in the code, and all others by the one that it becomes; [`RosArgs::out_of_name`] tells of those that name the old one.
//!
//! | argument | meaning |
//! |---|---|
//! | `-r`, `--remap [node:]from:=to` | rename a topic or service |
//! | `-r __node:=n`, `-r __ns:=/x` | name and namespace of the node |
//! | `-p`, `--param [node:]name:=value` | value (YAML) of a parameter |
//! | `--params-file f.yaml` | values from a file |
//! | `-e`, `--enclave /name` | keys of DDS Security, handed back as [`RosArgs::enclave`] |
//! | `--log-level [logger:=]level` | handed back as [`RosArgs::log_level`] |
//! | `--disable-rosout-logs`, `--disable-stdout-logs` | no log on `/rosout`, none on the terminal; `--enable-…` takes it back |
//! | `--disable-external-lib-logs`, `--enable-…` | nothing: there are no log files of another library |
//! | `--log-config-file f`, `--log-file-name f` | nothing, and that is said: they configure that library |

use std::path::PathBuf;

use thiserror::Error;

use super::meant::Meant;
use super::names::{NameError, NodeIdentity, RemapRule, check_part};
use super::yaml::{self, ParameterAssignment, YamlError};

/// What stands between `--ros-args` and `--`, understood.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RosArgs {
    /// `-r [node:]__node:=…`, in order: the first that fits the name in the code counts.
    pub node_names: Vec<Renamed>,
    /// `-r [node:]__ns:=…`, in the same way, by the name that the node has then.
    pub namespaces: Vec<Renamed>,
    /// All other `-r`, in the same way.
    pub remaps: Vec<RemapRule>,
    /// Parameter files and `-p`, in order: the last that fits counts.
    pub parameters: Vec<ParameterAssignment>,
    /// `--enclave`; the last counts.
    pub enclave: Option<String>,
    /// `--log-level`, as the filter of the log writes them: one for the program at most, and those of libraries, with commas between.
    pub log_level: Option<String>,
    /// `--disable-rosout-logs`.
    pub no_rosout: bool,
    /// `--disable-stdout-logs`.
    pub no_console: bool,
    /// What was given and changes nothing, to be told when there is a log.
    pub without_effect: Vec<String>,
    /// All of these as they were given, for programs that this one starts.
    pub words: Vec<String>,
}

/// Another name or namespace.
#[derive(Debug, Clone, PartialEq)]
pub struct Renamed {
    /// The node that is meant; none means every node.
    pub node: Option<String>,
    /// What it becomes.
    pub to: String,
}

/// An argument that cannot be followed.
#[derive(Debug, Error)]
pub enum ArgsError {
    /// Not an argument of ROS 2, or one that this node does not know.
    #[error(
        "unknown argument '{argument}' after --ros-args; known are -r, -p, --params-file, --enclave, --log-level, \
         --log-config-file, --log-file-name, and --enable- or --disable- with rosout-logs, stdout-logs and \
         external-lib-logs, and -- ends them"
    )]
    Unknown {
        /// The argument.
        argument: String,
    },
    /// A level that is none, or of a logger that this program has not.
    #[error(
        "--log-level '{value}': give debug, info, warn, error or fatal, for the whole program, or as library:=level for what one \
         library says; one node alone gets it behind `abbe node NAME … --ros-args`"
    )]
    Level {
        /// What was given.
        value: String,
    },
    /// An argument without its value.
    #[error("argument '{argument}' after --ros-args lacks its value ({expected})")]
    NoValue {
        /// The argument.
        argument: String,
        /// What should follow.
        expected: &'static str,
    },
    /// A value that is not an assignment.
    #[error("'{value}' after {argument} is not of the form {expected}")]
    NotAssignment {
        /// The argument.
        argument: String,
        /// Its value.
        value: String,
        /// What it should look like.
        expected: &'static str,
    },
    /// Nodes that a parameter is for.
    #[error("{argument}: {source}")]
    Node {
        /// The argument with its value.
        argument: String,
        /// What is wrong with the name before the colon.
        source: NameError,
    },
    /// A parameter's value or file.
    #[error(transparent)]
    Yaml(#[from] YamlError),
    /// The node's name or namespace.
    #[error(transparent)]
    Name(#[from] NameError),
}

impl RosArgs {
    /// Takes the ROS arguments off the command line: returns them and what remains, in order.
    /// There may be several groups from `--ros-args` to `--` or to the end.
    ///
    /// # Errors
    /// When an argument within a group is unknown, incomplete or cannot be read.
    pub fn split(arguments: impl IntoIterator<Item = String>) -> Result<(Self, Vec<String>), ArgsError> {
        let mut parsed = Self::default();
        let mut own = Vec::new();
        let mut arguments = arguments.into_iter();
        while let Some(argument) = arguments.next() {
            if argument == ROS_ARGS {
                let mut given = Vec::new();
                parsed.parse_group(&mut arguments.by_ref().inspect(|word| given.push(word.clone())))?;
                parsed.words.extend(given.into_iter().filter(|word| word != "--" && word != ROS_ARGS));
            } else {
                own.push(argument);
            }
        }
        Ok((parsed, own))
    }

    /// The identity of a node that is called `name` in `namespace` unless the arguments say else.
    ///
    /// # Errors
    /// When name or namespace are not ROS 2 names.
    pub fn identity(&self, namespace: &str, name: &str) -> Result<NodeIdentity, NameError> {
        let first = |renamed: &'_ [Renamed], name: &str| {
            let fits = |one: &&Renamed| one.node.as_deref().is_none_or(|node| node == name);
            renamed.iter().find(fits).map(|one| one.to.clone())
        };
        let name = first(&self.node_names, name).unwrap_or_else(|| name.to_owned());
        let namespace = first(&self.namespaces, &name).unwrap_or_else(|| namespace.to_owned());
        NodeIdentity::new(&namespace, &name)
    }

    /// Rules and values that name a node as it is called in the code, in words, where these arguments call it otherwise:
    /// they do not reach it.
    #[must_use]
    pub fn out_of_name(&self, name: &str, identity: &NodeIdentity) -> Vec<String> {
        if identity.name == name {
            return Vec::new();
        }
        let names_it = |node: &Option<String>| node.as_deref() == Some(name);
        let namespaces = self.namespaces.iter().filter(|one| names_it(&one.node));
        let namespaces = namespaces.map(|one| format!("-r {name}:__ns:={}", one.to));
        let remaps = self.remaps.iter().filter(|one| names_it(&one.node));
        let remaps = remaps.map(|one| format!("-r {name}:{}:={}", one.from, one.to));
        let in_code = NodeIdentity { name: name.to_owned(), ..identity.clone() };
        let names_old_one = |meant: &Meant| meant.fits(&in_code) && !meant.fits(identity);
        let parameters = self.parameters.iter().filter(|one| names_old_one(&one.meant)).map(|one| one.origin.clone());
        let now = &identity.name;
        let words = |one| format!("{one}: node {name} is called {now} here, so this does not reach it; name it {now}");
        namespaces.chain(remaps).chain(parameters).map(words).collect()
    }

    fn parse_group(&mut self, arguments: &mut impl Iterator<Item = String>) -> Result<(), ArgsError> {
        while let Some(argument) = arguments.next() {
            let mut value = |expected| {
                let argument = argument.clone();
                let missing = ArgsError::NoValue { argument, expected };
                arguments.next().ok_or(missing)
            };
            match argument.as_str() {
                "--" => break,
                // As launch writes it, where a node has `ros_arguments` besides.
                ROS_ARGS => {}
                "-r" | "--remap" => self.add_remap(&argument, &value(REMAP_FORM)?)?,
                "-p" | "--param" => self.add_parameter(&argument, &value(PARAM_FORM)?)?,
                "--params-file" => {
                    let path = PathBuf::from(value("a file")?);
                    self.parameters.extend(yaml::read_file(&path)?);
                }
                "-e" | "--enclave" => self.enclave = Some(value("a name such as /bridge_xyz")?),
                "--log-level" => self.add_level(directive(&value("a level such as info")?)?),
                "--enable-rosout-logs" => self.no_rosout = false,
                "--disable-rosout-logs" => self.no_rosout = true,
                "--enable-stdout-logs" => self.no_console = false,
                "--disable-stdout-logs" => self.no_console = true,
                "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
                "--log-config-file" | "--log-file-name" => {
                    let file = value("a file")?;
                    self.without_effect.push(format!("{argument} {file}"));
                }
                _ => return Err(ArgsError::Unknown { argument }),
            }
        }
        Ok(())
    }

    fn add_remap(&mut self, argument: &str, value: &str) -> Result<(), ArgsError> {
        let (node, from, to) = assignment(argument, value, REMAP_FORM)?;
        // No pattern: ROS 2 has them for parameters alone.
        if let Some((node, reason)) = node.and_then(|node| Some((node, check_part(node).err()?))) {
            let source = NameError { name: node.to_owned(), reason };
            return Err(ArgsError::Node { argument: format!("{argument} {value}"), source });
        }
        let (node, to) = (node.map(str::to_owned), to.to_owned());
        match from {
            "__node" | "__name" => self.node_names.push(Renamed { node, to }),
            "__ns" => self.namespaces.push(Renamed { node, to }),
            _ => self.remaps.push(RemapRule { node, from: from.to_owned(), to }),
        }
        Ok(())
    }

    /// One more level; of two for the whole program the last counts.
    fn add_level(&mut self, level: String) {
        let mut all: Vec<String> = self.log_level.iter().flat_map(|all| all.split(',')).map(str::to_owned).collect();
        all.retain(|one| one.contains('=') || level.contains('='));
        all.push(level);
        self.log_level = Some(all.join(","));
    }

    fn add_parameter(&mut self, argument: &str, value: &str) -> Result<(), ArgsError> {
        let (node, name, text) = assignment(argument, value, PARAM_FORM)?;
        let origin = format!("{argument} {value}");
        let meant = node.map_or_else(|| Ok(Meant::every_node()), Meant::parse);
        let meant = meant.map_err(|source| ArgsError::Node { argument: origin.clone(), source })?;
        let value = yaml::parse_value(name, text)?;
        self.parameters.push(ParameterAssignment { meant, name: name.to_owned(), value, origin });
        Ok(())
    }
}

/// A level as the filter of the log writes it: levels of ROS 2 are in any case, and `fatal` is an error.
fn directive(value: &str) -> Result<String, ArgsError> {
    let refused = || ArgsError::Level { value: value.to_owned() };
    let (logger, level) = value.split_once(":=").map_or((None, value), |(logger, level)| (Some(logger), level));
    let level = match level.to_lowercase().as_str() {
        "fatal" => "error".to_owned(),
        level if LEVELS.contains(&level) => level.to_owned(),
        _ => return Err(refused()),
    };
    // A logger of ROS 2 such as `bridge_xyz.scale` is a whole node; the filter knows parts of programs.
    let is_part = |logger: &str| logger.chars().all(|c| c.is_ascii_alphanumeric() || "_:".contains(c));
    match logger {
        None => Ok(level),
        Some(logger) if !logger.is_empty() && is_part(logger) => Ok(format!("{logger}={level}")),
        Some(_) => Err(refused()),
    }
}

/// Levels of the log, beside `fatal`.
const LEVELS: [&str; 6] = ["trace", "debug", "info", "warn", "error", "off"];

const ROS_ARGS: &str = "--ros-args";
const REMAP_FORM: &str = "[node:]from:=to";
const PARAM_FORM: &str = "[node:]name:=value";

/// `[node:]left:=right`.
fn assignment<'a>(
    argument: &str,
    value: &'a str,
    expected: &'static str,
) -> Result<(Option<&'a str>, &'a str, &'a str), ArgsError> {
    let wrong = || ArgsError::NotAssignment { argument: argument.to_owned(), value: value.to_owned(), expected };
    let (left, right) = value.split_once(":=").ok_or_else(wrong)?;
    let (node, left) = match left.split_once(':') {
        Some((node, left)) => (Some(node), left),
        None => (None, left),
    };
    if left.is_empty() || right.is_empty() || node.is_some_and(str::is_empty) {
        return Err(wrong());
    }
    Ok((node, left, right))
}

#[cfg(test)]
mod tests {
    use super::super::yaml::YamlValue;
    use super::*;

    fn split(line: &str) -> Result<(RosArgs, Vec<String>), ArgsError> {
        RosArgs::split(line.split(' ').map(str::to_owned))
    }

    #[test]
    fn ros_arguments_are_taken_off_and_the_others_stay() {
        let (args, own) = split(
            "--model m --ros-args -r scale:=/left/scale -r __ns:=/x -r __node:=n \
             -p rate_hz:=500.0 --remap t:a:=b --enclave /x/n --log-level debug -- --verbose",
        )
        .unwrap();
        assert_eq!(own, ["--model", "m", "--verbose"]);
        assert_eq!(args.identity("/", "default").unwrap().qualified(), "/x/n");
        assert_eq!(args.remaps.len(), 2);
        assert_eq!(args.remaps[1].node.as_deref(), Some("t"));
        assert_eq!(args.parameters[0].name, "rate_hz");
        assert_eq!(args.parameters[0].value, YamlValue::Double(500.0));
        assert_eq!((args.enclave.as_deref(), args.log_level.as_deref()), (Some("/x/n"), Some("debug")));
    }

    #[test]
    fn a_group_within_a_group_is_one_as_launch_writes_it() {
        let (args, own) = split("--launch f --ros-args --log-level info --ros-args -r __ns:=/x -- --last").unwrap();
        assert_eq!(own, ["--launch", "f", "--last"]);
        assert_eq!(args.words, ["--log-level", "info", "-r", "__ns:=/x"]);
        assert_eq!(args.identity("/", "n").unwrap().qualified(), "/x/n");
    }

    #[test]
    fn a_name_for_one_node_is_not_that_of_the_others_and_the_first_that_fits_counts() {
        let (args, _) =
            split("--ros-args -r scale:__node:=axes -r axes:__ns:=/left -r __ns:=/right -r __ns:=/late").unwrap();
        assert_eq!(args.identity("/", "scale").unwrap().qualified(), "/left/axes");
        assert_eq!(args.identity("/", "tracer").unwrap().qualified(), "/right/tracer");
    }

    #[test]
    fn what_names_a_renamed_node_as_before_is_told() {
        let (args, _) = split(
            "--ros-args -r scale:__node:=axes -r scale:__ns:=/left -r scale:scale/reading:=/x -p scale:rate_hz:=200.0 \
             -p /**/scale:rate_hz:=100.0 -p axes:rate_hz:=5.0 -r axes:a:=b -p /*:c:=1 -p rate_hz:=1.0 -p tracer:d:=1",
        )
        .unwrap();
        let axes = args.identity("/", "scale").unwrap();
        assert_eq!(axes.qualified(), "/axes");
        let told = args.out_of_name("scale", &axes);
        let named: Vec<&str> =
            told.iter().map(|words| words.split(": node scale is called axes").next().unwrap()).collect();
        let wanted = [
            "-r scale:__ns:=/left",
            "-r scale:scale/reading:=/x",
            "-p scale:rate_hz:=200.0",
            "-p /**/scale:rate_hz:=100.0",
        ];
        assert_eq!(named, wanted);
        assert!(args.out_of_name("tracer", &args.identity("/", "tracer").unwrap()).is_empty());
    }

    #[test]
    fn arguments_about_the_log_are_those_of_ros_2() {
        let (args, _) = split("--ros-args --log-level rcl:=FATAL --disable-rosout-logs --disable-stdout-logs").unwrap();
        assert_eq!((args.log_level.as_deref(), args.no_rosout, args.no_console), (Some("rcl=error"), true, true));
        let (args, _) = split("--ros-args --disable-rosout-logs --enable-rosout-logs --log-config-file f").unwrap();
        assert!(!args.no_rosout && !args.no_console);
        assert_eq!(args.without_effect, ["--log-config-file f"]);
        let all = "--ros-args --log-level info --log-level rustdds:=warn --log-level debug";
        assert_eq!(split(all).unwrap().0.log_level.as_deref(), Some("rustdds=warn,debug"));
    }

    #[test]
    fn nothing_is_ignored() {
        for (line, part) in [
            ("--ros-args --enclave", "/bridge_xyz"),
            ("--ros-args stray", "stray"),
            ("--ros-args -r", "[node:]from:=to"),
            ("--ros-args -r a=b", "a=b"),
            ("--ros-args -r :=b", ":=b"),
            ("--ros-args -p a:=", "a:="),
            ("--ros-args -p a:=[1", "a"),
            ("--ros-args -p cmm*:window:=3", "-p cmm*:window:=3: 'cmm*'"),
            ("--ros-args -p a//b:window:=3", "a part is empty"),
            ("--ros-args -r *:scale:=/x", "-r *:scale:=/x: '*'"),
            ("--ros-args -r hall/scale:__ns:=/x", "'hall/scale'"),
            ("--ros-args --params-file /nowhere.yaml", "/nowhere.yaml"),
            ("--ros-args --log-level bogus", "'bogus': give debug"),
            ("--ros-args --log-level bridge_xyz.scale:=info", "abbe node NAME"),
            ("--ros-args --log-level rcl:=", "'rcl:='"),
        ] {
            let message = split(line).unwrap_err().to_string();
            assert!(message.contains(part), "{line}: {message}");
        }
    }
}
