//! Documents against what they describe: tables that lag behind the code are caught.
//!
//! Place in the flow: text of a Markdown file or script in, what it lacks out.

/// Words that a document does not name in code quotes (`` `word` ``).
pub fn not_named(document: &str, words: &[String]) -> Vec<String> {
    words.iter().filter(|word| !document.contains(&format!("`{word}`"))).cloned().collect()
}

/// The commands of the first block of code of a document, comments and empty lines left out.
pub fn first_commands(document: &str) -> Vec<String> {
    let mut lines = document.lines().skip_while(|line| !line.trim_start().starts_with("```")).skip(1);
    let block = lines.by_ref().take_while(|line| !line.trim_start().starts_with("```"));
    let commands = block.map(|line| line.split(" #").next().unwrap_or_default().trim().to_owned());
    commands.filter(|command| !command.is_empty() && !command.starts_with('#')).collect()
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

/// Whether a script runs a command: a line of it ends in these words.
pub fn runs(script: &str, command: &str) -> bool {
    script.lines().any(|line| !line.trim_start().starts_with('#') && line.trim_end().ends_with(command))
}

/// Targets of the links of a Markdown document that lead to files of the project.
pub fn local_links(document: &str) -> Vec<String> {
    let targets = document.match_indices("](").filter_map(|(at, _)| document[at + 2..].split(')').next());
    let local = targets.filter(|target| !target.contains("://") && !target.starts_with('#') && !target.is_empty());
    local.map(|target| target.split('#').next().unwrap_or_default().to_owned()).collect()
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
    fn a_command_in_a_comment_is_not_run() {
        assert!(runs("step tests cargo test --workspace\n", "cargo test --workspace"));
        assert!(!runs("# cargo test --workspace\ncargo test --workspace --lib\n", "cargo test --workspace"));
    }

    #[test]
    fn links_to_files_are_told_from_links_to_sites() {
        let text = "[a](nodes/README.md) [b](https://x.org/y) [c](#here) [d](ARCHITECTURE.md#wire)";
        assert_eq!(local_links(text), ["nodes/README.md", "ARCHITECTURE.md"]);
    }
}
