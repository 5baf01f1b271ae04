//! README and the book under `docs/`: every command in them runs, every link leads somewhere.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use system_tests::{image, program};

/// The one command that is no program of the workspace; `image::elf` runs it.
const IMAGE_BUILD: &str = "cargo build -p firmware --profile firmware --target thumbv7em-none-eabihf";

/// What needs a cluster or other tools, or never ends: `cluster/test-slurm` runs the first two, nothing the third, `./test sumo` the fourth;
/// the browser's test serves the page, and the last is what runs this test.
const ELSEWHERE: [&str; 6] = [
    "export HOST_SIM",
    "cluster/submit",
    "snakemake",
    "cargo run --release -- loop --traffic sumo",
    "python3 -m http.server",
    "./test",
];

/// A chapter: its name and text.
struct Chapter {
    path: PathBuf,
    text: String,
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .canonicalize()
        .unwrap()
}

/// All chapters of the book, by name.
fn chapters() -> Vec<Chapter> {
    let docs = repository().join("docs");
    let entries = std::fs::read_dir(docs)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = entries
        .filter(|path| path.extension().is_some_and(|end| end == "md"))
        .collect();
    paths.sort();
    paths.into_iter().map(chapter).collect()
}

fn chapter(path: PathBuf) -> Chapter {
    Chapter {
        text: std::fs::read_to_string(&path).unwrap(),
        path,
    }
}

/// The commands of a chapter's console blocks, in order, without the words that explain them.
fn commands(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut in_console = false;
    for event in Parser::new(text) {
        match event {
            Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(language))) => {
                // A block in another language of the shell would escape this test.
                assert!(
                    !["sh", "bash", "shell"].contains(&&*language),
                    "shell blocks are `console` here"
                );
                in_console = &*language == "console";
            }
            Event::End(TagEnd::CodeBlock) => in_console = false,
            Event::Text(block) if in_console => {
                found.extend(
                    block
                        .lines()
                        .filter_map(|line| line.strip_prefix("$ "))
                        .map(|line| line.split(" #").next().unwrap_or(line).trim().to_owned()),
                );
            }
            _ => {}
        }
    }
    found
}

/// Programs of the workspace, by what the book calls them.
fn programs() -> [(&'static str, PathBuf); 2] {
    [
        ("cargo run --release -p trainer -- ", program("trainer")),
        ("cargo run --release", program("host-sim")),
    ]
}

/// A folder in which the book's relative paths exist, and what commands write does not reach the repository.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["assignment", "host-sim", "trainer", "cluster", "docs"] {
        std::os::unix::fs::symlink(repository().join(name), folder.path().join(name)).unwrap();
    }
    folder
}

#[test]
fn every_command_of_readme_and_book_runs() {
    let programs = programs();
    let readme = chapter(repository().join("README.md"));
    for Chapter { path, text } in std::iter::once(readme).chain(chapters()) {
        // One folder a chapter: its commands build on each other, and on no other chapter's.
        let folder = workplace();
        for command in commands(&text) {
            if ELSEWHERE.iter().any(|elsewhere| command.starts_with(elsewhere)) {
                continue;
            }
            let known = programs
                .iter()
                .find_map(|(prefix, program)| Some((program.clone(), command.strip_prefix(prefix)?)));
            // Cargo has built the examples, too.
            let example = command.split_once("--example ");
            let example = example.map(|(_, name)| (program(&format!("examples/{name}")), ""));
            let mut process = match example.or(known) {
                Some((program, rest)) => {
                    let mut process = Command::new(program);
                    let rest = rest.trim_start_matches(" --").trim();
                    let _ = process.args(rest.split_whitespace()).current_dir(folder.path());
                    process
                }
                None => {
                    // The image's own tests build it, in a target folder that is theirs.
                    assert_eq!(command, IMAGE_BUILD, "{}", path.display());
                    let _ = image::elf();
                    continue;
                }
            };
            let output = process.output().unwrap();
            let errors = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{}: {command}: {errors}", path.display());
        }
    }
}

/// The anchors of a text's headings, as GitHub and mdBook make them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut heading = None;
    for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
        match event {
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::Text(part) | Event::Code(part) => {
                if let Some(heading) = &mut heading {
                    heading.push_str(&part);
                }
            }
            Event::End(TagEnd::Heading(_)) => {
                let words = heading
                    .take()
                    .unwrap_or_default()
                    .to_lowercase()
                    .replace(' ', "-");
                let _ = found.insert(
                    words
                        .chars()
                        .filter(|c| c.is_alphanumeric() || "-_".contains(*c))
                        .collect(),
                );
            }
            _ => {}
        }
    }
    found
}

#[test]
fn every_link_leads_somewhere() {
    let others = [
        "README.md",
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
        "firmware/README.md",
    ]
    .map(|name| chapter(repository().join(name)));
    let chapters = chapters();
    let mut checked = 0;
    for (index, Chapter { path, text }) in chapters.iter().chain(&others).enumerate() {
        for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
            let Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) = event else {
                continue;
            };
            if dest_url.starts_with("https://") || dest_url.starts_with("http://") {
                continue;
            }
            // A built book holds its chapters alone.
            let leaves_the_book = index < chapters.len() && dest_url.starts_with("..");
            assert!(!leaves_the_book, "{}: {dest_url} leaves the book", path.display());
            let (file, anchor) = dest_url
                .split_once('#')
                .map_or((&*dest_url, None), |(file, anchor)| (file, Some(anchor)));
            let target = if file.is_empty() {
                path.clone()
            } else {
                path.parent().unwrap().join(file)
            };
            assert!(target.exists(), "{}: {dest_url}", path.display());
            if let Some(anchor) = anchor {
                let found = anchors(&std::fs::read_to_string(&target).unwrap());
                assert!(
                    found.contains(anchor),
                    "{}: {dest_url}: anchors {found:?}",
                    path.display()
                );
            }
            checked += 1;
        }
    }
    assert!(checked > 10);
    let summary = std::fs::read_to_string(repository().join("docs/SUMMARY.md")).unwrap();
    for Chapter { path, .. } in &chapters {
        let name = path.file_name().unwrap().to_string_lossy();
        assert!(
            name == "SUMMARY.md" || summary.contains(&format!("({name})")),
            "{name} is in no table of contents"
        );
    }
}
