//! Text for terminals.

/// Columns of a terminal that everybody has.
pub const WIDTH: usize = 80;

/// Breaks lines between words so that they fit [`WIDTH`]; further lines of a paragraph begin with `indent`.
pub fn wrapped(text: &str, indent: &str) -> String {
    let options = textwrap::Options::new(WIDTH)
        .subsequent_indent(indent)
        .break_words(false)
        .word_separator(textwrap::WordSeparator::AsciiSpace)
        .word_splitter(textwrap::WordSplitter::NoHyphenation);
    textwrap::fill(text, options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words_and_words_stay_whole() {
        let path = "a/".repeat(50);
        let text = wrapped(
            &format!("Written: {path} and one-two {}", "word ".repeat(20)),
            "  ",
        );
        assert!(text.contains(&path) && text.contains("one-two"), "{text}");
        let longest = text
            .lines()
            .filter(|line| !line.contains(&path))
            .map(str::len)
            .max();
        assert!(longest.unwrap() <= WIDTH, "{text}");
        assert!(text.lines().skip(1).all(|line| line.starts_with("  ")), "{text}");
    }
}
