//! Documents against what they describe: tables that lag behind the code are caught.
//!
//! Place in the flow: text of a Markdown file or script in, what it lacks out.

use std::collections::{BTreeMap, BTreeSet};

/// Words that a document does not name in code quotes (`` `word` ``).
pub fn not_named(document: &str, words: &[String]) -> Vec<String> {
    words.iter().filter(|word| !document.contains(&format!("`{word}`"))).cloned().collect()
}

/// Of each room of a layer, in tables of a map, the rooms that its last column names: ``| `nodes/a` | what it is | `b`, `c` |``.
pub fn arrows(map: &str, layer: &str) -> BTreeMap<String, BTreeSet<String>> {
    let row = |line: &str| {
        let cells: Vec<&str> = line.trim().trim_matches('|').split('|').collect();
        let quoted = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<String>>();
        let room = quoted(cells.first()?).into_iter().find(|room| room.starts_with(&format!("{layer}/")))?;
        Some((room, quoted(cells.get(2)?).into_iter().map(|other| format!("{layer}/{other}")).collect()))
    };
    map.lines().filter(|line| line.starts_with('|')).filter_map(row).collect()
}

/// The commands of the first block of code of a document, comments and empty lines left out.
pub fn first_commands(document: &str) -> Vec<String> {
    let lines = document.lines().skip_while(|line| !line.trim_start().starts_with("```")).skip(1);
    let block: Vec<&str> = lines.take_while(|line| !line.trim_start().starts_with("```")).collect();
    commands(&block.join("\n"))
}

/// Blocks of code of one language, such as `toml`.
pub fn blocks(document: &str, language: &str) -> Vec<String> {
    let (mut found, mut open): (Vec<String>, Option<String>) = (Vec::new(), None);
    for line in document.lines() {
        match (&mut open, line.trim_end().strip_prefix("```")) {
            (None, Some(named)) => open = Some(if named == language { String::new() } else { "-".to_owned() }),
            (Some(_), Some(_)) => found.extend(open.take().filter(|block| block != "-")),
            (Some(block), None) if block != "-" => {
                block.push_str(line);
                block.push('\n');
            }
            _ => {}
        }
    }
    found
}

/// Blocks of commands that neither run nor say why not, each with its line. What `console,no-run` says stands in the line before it, as
/// `<!-- not run: REASON -->`, which readers of the page do not see. Commands under another name would run nowhere, and tell nobody.
pub fn unexplained(document: &str) -> Vec<(usize, String)> {
    let lines: Vec<&str> = document.lines().collect();
    let (mut found, mut is_open) = (Vec::new(), false);
    for (k, line) in lines.iter().enumerate() {
        let Some(language) = line.trim().strip_prefix("```") else { continue };
        is_open = !is_open;
        if !is_open {
            continue;
        }
        let before = k.checked_sub(1).and_then(|k| lines.get(k)).copied().unwrap_or_default();
        let reason = before.trim().strip_prefix("<!-- not run: ").and_then(|rest| rest.strip_suffix("-->"));
        let wrong = match language {
            _ if language.starts_with("console") && line.starts_with(' ') => "is indented, so that no test finds it",
            "console" | "console,refused" if reason.is_some() => "says why it is not run, and is run",
            "console" | "console,refused" => continue,
            "console,no-run" if reason.is_some_and(|reason| !reason.trim().is_empty()) => continue,
            "console,no-run" => "says in no line before it why it is not run: <!-- not run: REASON -->",
            "" | "sh" | "bash" | "shell" | "shell-session" => {
                "is not marked: `console` for commands, `text` for what is printed"
            }
            _ if language.starts_with("console") => "is marked as no test knows it",
            _ => continue,
        };
        found.push((k + 1, format!("```{language} {wrong}")));
    }
    found
}

/// The commands of a block of code: lines that end in a backslash joined, comments and empty lines left out.
pub fn commands(block: &str) -> Vec<String> {
    let joined = block.replace("\\\n", " ");
    let whole = joined.lines().map(|line| line.split(" #").next().unwrap_or_default());
    let words = whole.map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
    words.filter(|command| !command.is_empty() && !command.starts_with('#')).collect()
}

/// Calls of a program in a document: in blocks of code of one language, and in code spans that begin with its name.
pub fn calls(document: &str, language: &str, program: &str) -> Vec<String> {
    let lines: Vec<String> = blocks(document, language).iter().flat_map(|block| commands(block)).collect();
    // A bar in a table stands behind a backslash.
    let prose = document.replace("\\|", "/");
    let spans = prose.split("```").step_by(2).flat_map(|text| text.split('`').skip(1).step_by(2));
    let spans = spans.map(|span| span.split_whitespace().collect::<Vec<_>>().join(" "));
    let parts = lines.iter().flat_map(|line| line.split(['|', ';', '&'])).map(|part| part.trim().to_owned());
    parts.chain(spans).filter(|call| call.split(' ').next() == Some(program)).collect()
}

/// The subcommand of a call, where it names one, and the options that it names.
pub fn subcommand_and_options(call: &str) -> (Option<&str>, Vec<&str>) {
    let words: Vec<&str> =
        call.split([' ', '[', ']', '(', ')', ',', '/', '=']).filter(|word| !word.is_empty()).collect();
    let is_name = |word: &&&str| word.starts_with(|c: char| c.is_ascii_lowercase());
    let options = words.iter().filter(|word| word.len() > 2 && word.starts_with("--")).copied().collect();
    (words.get(1).filter(is_name).copied(), options)
}

/// Whether a script runs a command: a line of it ends in these words, whatever feature of cargo it names besides, and optimised or not; of
/// `cargo run`, the program that tests have built will do.
pub fn runs(script: &str, command: &str) -> bool {
    let plain = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let is_feature = |place: usize| words[place] == "--features" || (place > 0 && words[place - 1] == "--features");
        let is_kept = |place: &usize| !is_feature(*place) && words[*place] != "--release";
        (0..words.len()).filter(is_kept).map(|place| words[place]).collect::<Vec<_>>().join(" ")
    };
    let command = plain(command);
    let built = command.replace("cargo run --", "/debug/abbe");
    let is_it = |line: &str| line.ends_with(&command) || line.ends_with(&built);
    script.lines().any(|line| !line.trim_start().starts_with('#') && is_it(&plain(line).replace('"', "")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_that_a_table_lacks_is_caught() {
        let words = ["corrected".to_owned(), "scale/reading".to_owned()];
        assert_eq!(not_named("| `corrected` | x |\n| scale/reading | y |", &words), ["scale/reading"]);
    }

    #[test]
    fn a_map_names_rooms_with_those_that_they_are_built_on() {
        let map = "| room | one line | built on |\n|---|---|---|\n| `nodes/a` | says `x` | `b`, `c` |\n| `nodes/b` | y | |\n| `models/m` | z | `k` |\n";
        let on = |rooms: &[&str]| rooms.iter().map(|room| (*room).to_owned()).collect::<BTreeSet<String>>();
        let expected = [("nodes/a".to_owned(), on(&["nodes/b", "nodes/c"])), ("nodes/b".to_owned(), on(&[]))];
        assert_eq!(arrows(map, "nodes"), expected.into());
    }

    #[test]
    fn the_first_commands_are_those_of_the_first_block() {
        let text = "# A\n\n```sh\n# main\ncargo run # shows it\n\ncargo test\n```\n```\nother\n```\n";
        assert_eq!(first_commands(text), ["cargo run", "cargo test"]);
        assert!(first_commands("no block").is_empty());
    }

    #[test]
    fn blocks_of_one_language_are_told_from_others() {
        let text = "```sh\na\n```\n```toml\nb = 1\nc = 2\n```\nbetween\n```toml\nd = 3\n```\n```toml\nnever closed\n";
        assert_eq!(blocks(text, "toml"), ["b = 1\nc = 2\n", "d = 3\n"]);
    }

    #[test]
    fn a_block_that_neither_runs_nor_says_why_not_is_caught() {
        let why = "<!-- not run: wants a machine -->\n";
        let fine = format!(
            "```console\na\n```\n{why}```console,no-run\nb\n```\n```text\nc\n```\n```console,refused\nd\n```\n"
        );
        assert_eq!(unexplained(&fine), []);
        let lines = |document: &str| unexplained(document).into_iter().map(|(line, _)| line).collect::<Vec<_>>();
        assert_eq!(lines("a\n```console,no-run\nb\n```\n"), [2], "without a reason");
        assert_eq!(lines("<!-- not run:  -->\n```console,no-run\nb\n```\n"), [2], "with an empty one");
        assert_eq!(lines(&format!("{why}\n```console,no-run\nb\n```\n")), [3], "the reason belongs to something else");
        assert_eq!(lines(&format!("{why}```console\nb\n```\n")), [2], "it is run all the same");
        assert_eq!(lines("```sh\na\n```\n```\nb\n```\n```console,norun\nc\n```\n"), [1, 4, 7], "other names");
        assert_eq!(lines("- a\n  ```console\n  b\n  ```\n"), [2], "indented");
    }

    #[test]
    fn a_command_in_a_comment_is_not_run() {
        assert!(runs("step tests cargo test --workspace\n", "cargo test --workspace"));
        assert!(!runs("# cargo test --workspace\ncargo test --workspace --lib\n", "cargo test --workspace"));
        assert!(runs("  cargo run --features opcua -- demo\n", "cargo run -- demo"));
        assert!(!runs("  cargo run --features opcua -- demo --fast\n", "cargo run -- demo"));
        assert!(runs("  cargo run -- demo\n", "cargo run --release -- demo"));
        assert!(runs("step 'main job' \"$folder/debug/abbe\" demo\n", "cargo run --release -- demo"));
        assert!(!runs("\"$folder/debug/abbe\" demo --fast\n", "cargo run --release -- demo"));
    }

    #[test]
    fn calls_are_found_in_blocks_and_in_spans() {
        let text = "`abbe a\n--b` `other`\n```console\nabbe c \\\n  --d e # f\ncat g | abbe h --i=j\n```\n| `abbe k [--l x\\|y]` |\n";
        let found = calls(text, "console", "abbe");
        assert_eq!(found, ["abbe c --d e", "abbe h --i=j", "abbe a --b", "abbe k [--l x/y]"]);
        assert_eq!(subcommand_and_options(&found[1]), (Some("h"), vec!["--i"]));
        assert_eq!(subcommand_and_options(&found[3]), (Some("k"), vec!["--l"]));
        assert_eq!(subcommand_and_options("abbe --version"), (None, vec!["--version"]));
        assert_eq!(subcommand_and_options("abbe COMMAND --help"), (None, vec!["--help"]));
    }
}
