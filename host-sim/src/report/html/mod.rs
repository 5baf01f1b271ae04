//! Reports as one HTML file that stands alone: no script, no request to anywhere, light or dark as the reader prefers, readable on a
//! phone and on paper. What the reader asks first is answered first.

use super::answers::Answer;
use super::chart::dark;
use super::table::Table;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("style.css");

/// A report.
pub struct Page {
    /// What was done.
    pub title: String,
    /// One or two sentences below the title.
    pub summary: String,
    /// What the report answers first.
    pub answers: Vec<Answer>,
    /// What was run: names and values.
    pub facts: Vec<(&'static str, String)>,
    /// The rest, in order.
    pub sections: Vec<Section>,
}

/// A part of a report with its own heading.
pub struct Section {
    /// Heading, also in the contents.
    pub heading: &'static str,
    /// What it is about and what to see.
    pub text: String,
    /// Tables and figures.
    pub blocks: Vec<Block>,
}

/// A table, a figure or a folded text.
pub struct Block(Markup);

impl Block {
    /// A table.
    pub fn table(table: &Table) -> Self {
        let columns = table.shown_columns();
        Self(html! {
            div.wide tabindex="0" role="group" aria-label="Table" {
                table {
                    @if !table.title().is_empty() { caption { (table.title()) } }
                    thead { tr {
                        @for column in &columns {
                            th.text[column.is_text()] scope="col" {
                                (column.head().replace("+-", "±"))
                                @if !column.unit().is_empty() { small { (column.unit()) } }
                            }
                        }
                    } }
                    tbody { @for row in 0..table.rows() { tr {
                        @for column in &columns { td.text[column.is_text()] { (column.written(row)) } }
                    } } }
                }
            }
            div.notes { @for note in table.notes() { p { (note) } } }
        })
    }

    /// A figure: SVG of this crate's charts, and what to see in it.
    pub fn figure(svg: &str, caption: &str) -> Self {
        Self(html! {
            figure {
                div.wide tabindex="0" role="group" aria-label="Figure" { (PreEscaped(svg)) }
                figcaption { (caption) }
            }
        })
    }

    /// Names and what they stand for.
    pub fn terms(terms: &[(&str, String)]) -> Self {
        Self(html! { dl { @for (name, value) in terms { dt { (name) } dd { (value) } } } })
    }

    /// A command to type.
    pub fn command(command: &str) -> Self {
        Self(html! { pre tabindex="0" aria-label="Command" { code { (command) } } })
    }

    /// Long text that unfolds.
    pub fn folded(summary: &str, text: &str) -> Self {
        Self(html! { details { summary { (summary) } pre tabindex="0" aria-label=(summary) { (text) } } })
    }
}

impl Page {
    /// The file.
    pub fn render(&self) -> String {
        let anchor = |index: usize| format!("part-{}", index + 1);
        html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    // An empty icon, so that no browser asks a server for one.
                    link rel="icon" href="data:,";
                    title { (self.title) }
                    style { (PreEscaped(STYLE)) "\n@media screen and (prefers-color-scheme: dark) {\n" (PreEscaped(dark::style())) "}\n" }
                }
                body {
                    main {
                        h1 { (self.title) }
                        p { (self.summary) }
                        @for answer in &self.answers {
                            section.answer {
                                h2 { (answer.question) }
                                p.verdict { (answer.verdict) }
                                p { (answer.reasons) }
                            }
                        }
                        (Block::terms(&self.facts).0)
                        nav aria-label="Contents" {
                            @for (index, section) in self.sections.iter().enumerate() {
                                a href={ "#" (anchor(index)) } { (section.heading) }
                            }
                        }
                        @for (index, section) in self.sections.iter().enumerate() {
                            section id=(anchor(index)) {
                                h2 { (section.heading) }
                                p { (section.text) }
                                @for block in &section.blocks { (block.0) }
                            }
                        }
                    }
                }
            }
        }
        .into_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::table::Column;

    #[test]
    fn a_page_stands_alone_and_escapes_what_it_is_given() {
        let columns = vec![
            Column::text("who", ["<b>".to_owned()]),
            Column::number("age_ms", [4.25]).shown("age", "ms", 1),
        ];
        let table = Table::new(columns).unwrap().titled("A < B");
        let page = Page {
            title: "Run & report".to_owned(),
            summary: "All.".to_owned(),
            answers: vec![Answer {
                question: "What?",
                verdict: "This & that.".to_owned(),
                reasons: "Because.".to_owned(),
            }],
            facts: vec![("seed", "1".to_owned())],
            sections: vec![Section {
                heading: "Ages",
                text: "What to see.".to_owned(),
                blocks: vec![Block::table(&table), Block::figure("<svg></svg>", "One.")],
            }],
        }
        .render();
        for part in [
            "Run &amp; report",
            "This &amp; that.",
            "A &lt; B",
            "&lt;b&gt;",
            "4.2",
            "<svg></svg>",
            "href=\"#part-1\"",
        ] {
            assert!(page.contains(part), "{part} in {page}");
        }
        for forbidden in ["http:", "https:", "<script", "@import", "url("] {
            assert!(!page.contains(forbidden), "{forbidden} in {page}");
        }
    }
}
