//! The site: README, the book, and whatever they link to, as pages that any web server serves.
//!
//! `freshlane-site REPOSITORY FOLDER` begins with README and the book's table of contents and follows links within the repository.
//! Texts become pages under the same path, everything else is copied; a link that leads nowhere is an error. Nothing is asked of the network.

use kit::error::{Error, Result};
use kit::files::write_whole;
use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd, html};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

/// The text that becomes `index.html`, and the one whose links stand at the head of every page.
const FIRST: &str = "README.md";
const CONTENTS: &str = "docs/SUMMARY.md";

const STYLE: &str = include_str!("style.css");

/// What `site/build` puts beside the pages, by its name in the head of each.
const BESIDE: [(&str, &str); 2] = [("page/index.html", "Try it"), ("gallery/index.html", "Gallery")];

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let done = match arguments.as_slice() {
        [repository, folder] => build(repository, folder),
        _ => Err(Error::input(
            "arguments",
            format!("{} of them", arguments.len()),
            "the repository's folder and the site's",
        )),
    };
    match done {
        Ok(pages) => {
            println!("{pages} pages");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Writes the site and says how many pages it has.
///
/// # Errors
/// A file that cannot be read or written, or a link that leads nowhere.
fn build(repository: &Path, folder: &Path) -> Result<usize> {
    let contents = read(repository, Path::new(CONTENTS))?;
    let (mut open, mut pages) = (vec![PathBuf::from(FIRST)], BTreeMap::new());
    while let Some(path) = open.pop() {
        if pages.contains_key(&path) {
            continue;
        }
        let text = read(repository, &path)?;
        // The table of contents leads to chapters that nobody else links to.
        let links = links(&text).into_iter().map(|link| (path.clone(), link));
        let chapters = self::links(&contents).into_iter();
        let chapters = chapters.map(|link| (PathBuf::from(CONTENTS), link));
        for (from, link) in links.chain(chapters) {
            let Some(target) = target(&from, &link) else {
                continue;
            };
            let source = repository.join(&target);
            if !source.exists() {
                return Err(Error::input(
                    from.display(),
                    link,
                    "a link to a file of the repository",
                ));
            }
            if target.extension().is_some_and(|end| end == "md") {
                open.push(target);
            } else if source.is_file() {
                let bytes = fs::read(&source).map_err(|error| Error::file(&source, error))?;
                write(&folder.join(&target), &bytes)?;
            }
        }
        let _ = pages.insert(path, text);
    }
    for (path, text) in &pages {
        write(
            &folder.join(page_of(path)),
            page(path, text, &contents).as_bytes(),
        )?;
    }
    write(&folder.join("style.css"), STYLE.as_bytes())?;
    Ok(pages.len())
}

fn read(repository: &Path, path: &Path) -> Result<String> {
    let path = repository.join(path);
    fs::read_to_string(&path).map_err(|error| Error::file(&path, error))
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|error| Error::file(folder, error))?;
    }
    write_whole(path, bytes)
}

fn parse(text: &str) -> Parser<'_> {
    Parser::new_ext(text, Options::ENABLE_TABLES)
}

/// Addresses that a text links to or shows, those in its HTML too.
fn links(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for event in parse(text) {
        match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                found.push(dest_url.to_string());
            }
            Event::Html(markup) | Event::InlineHtml(markup) => {
                let values = ["src=\"", "srcset=\""].into_iter();
                let values = values.filter_map(|name| markup.split_once(name)?.1.split('"').next());
                found.extend(values.map(str::to_owned));
            }
            _ => {}
        }
    }
    found
}

/// The file of the repository that a link means; `None` if it leads elsewhere, or to a place of its own page.
fn target(from: &Path, link: &str) -> Option<PathBuf> {
    let file = link.split('#').next().filter(|file| !file.is_empty())?;
    if file.contains("://") || file.starts_with("mailto:") {
        return None;
    }
    let mut path = PathBuf::new();
    for part in from.parent()?.join(file).components() {
        match part {
            Component::ParentDir => {
                let _ = path.pop();
            }
            Component::CurDir => {}
            part => path.push(part),
        }
    }
    Some(path)
}

/// Where a text's page lies in the site.
fn page_of(path: &Path) -> PathBuf {
    if path == Path::new(FIRST) {
        return PathBuf::from("index.html");
    }
    path.with_extension("html")
}

/// From a page to another of the site, as a relative address.
fn address(from: &Path, to: &Path) -> String {
    let up = from.parent().map_or(0, |folder| folder.components().count());
    format!("{}{}", "../".repeat(up), to.display())
}

/// A link of a text as its page has it.
fn linked(path: &Path, link: &str) -> Option<String> {
    let target = target(path, link)?;
    let anchor = link
        .split_once('#')
        .map_or(String::new(), |(_, anchor)| format!("#{anchor}"));
    let text = target.extension().is_some_and(|end| end == "md");
    let to = if text { page_of(&target) } else { target };
    Some(address(path, &to) + &anchor)
}

/// A text as a whole page.
fn page(path: &Path, text: &str, contents: &str) -> String {
    let title = heading(text);
    let mut body = String::new();
    html::push_html(&mut body, page_events(path, text).into_iter());
    // A heading without words is none.
    let body = body.replace("<th></th>", "<td></td>");
    // The style and the parts beside are seen from the page's own folder.
    let to = |name: &str| address(path, Path::new(name));
    let mut navigation = format!("<a href=\"{}\">Freshlane</a>", to("index.html"));
    for (name, words) in BESIDE {
        navigation += &format!(" <a href=\"{}\">{words}</a>", to(name));
    }
    let mut chapters = String::new();
    html::push_html(&mut chapters, chapter_events(path, contents).into_iter());
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{title}</title>\n<link rel=\"icon\" href=\"data:,\">\n<link rel=\"stylesheet\" href=\"{}\">\n</head>\n<body>\n\
         <header><nav aria-label=\"Site\">{navigation}</nav></header>\n<main>\n{body}</main>\n\
         <footer><nav aria-label=\"The book\">\n<h2>The book</h2>\n{chapters}</nav></footer>\n</body>\n</html>\n",
        to("style.css"),
    )
}

/// The first heading of a text.
fn heading(text: &str) -> &str {
    let first = text.lines().find_map(|line| line.strip_prefix("# "));
    first.unwrap_or("Freshlane").trim()
}

/// A text with its links to pages, its headings with the anchors that GitHub gives them, and wide things that scroll by themselves.
fn page_events<'a>(path: &Path, text: &'a str) -> Vec<Event<'a>> {
    let mut events: Vec<Event<'a>> = Vec::new();
    let mut heading = None;
    for mut event in parse(text) {
        if let Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) = &mut event
            && let Some(there) = linked(path, dest_url)
        {
            *dest_url = there.into();
        }
        match event {
            Event::Start(Tag::Heading { .. }) => {
                heading = Some((events.len(), String::new()));
                events.push(event);
            }
            Event::End(TagEnd::Heading(_)) => {
                if let Some((at, words)) = heading.take()
                    && let Event::Start(Tag::Heading { id, .. }) = &mut events[at]
                {
                    *id = Some(anchor(&words).into());
                }
                events.push(event);
            }
            Event::Start(Tag::Table(_)) => {
                events.push(Event::Html(scrolling("Table").into()));
                events.push(event);
            }
            Event::Start(Tag::CodeBlock(_)) => {
                events.push(Event::Html(scrolling("Code").into()));
                events.push(event);
            }
            Event::End(TagEnd::Table | TagEnd::CodeBlock) => {
                events.push(event);
                events.push(Event::Html("</div>\n".into()));
            }
            event => {
                if let (Some((_, words)), Event::Text(part) | Event::Code(part)) = (&mut heading, &event) {
                    words.push_str(part);
                }
                events.push(event);
            }
        }
    }
    events
}

/// The begin of what may be wider than its page, and then scrolls, with the keyboard too.
fn scrolling(what: &str) -> String {
    format!("<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{what}\">")
}

/// The table of contents as seen from a page, without its own heading.
fn chapter_events<'a>(path: &Path, contents: &'a str) -> Vec<Event<'a>> {
    let events = parse(contents).skip_while(|event| !matches!(event, Event::End(TagEnd::Heading(_))));
    let linked = events.skip(1).map(|event| match event {
        Event::Start(Tag::Link {
            link_type,
            dest_url,
            title,
            id,
        }) => {
            let chapter = target(Path::new(CONTENTS), &dest_url);
            let dest_url = chapter.map_or(dest_url, |chapter| address(path, &page_of(&chapter)).into());
            Event::Start(Tag::Link {
                link_type,
                dest_url,
                title,
                id,
            })
        }
        event => event,
    });
    linked.collect()
}

/// The anchor of a heading, as GitHub and mdBook make it.
fn anchor(words: &str) -> String {
    let words = words.to_lowercase().replace(' ', "-");
    words
        .chars()
        .filter(|letter| letter.is_alphanumeric() || "-_".contains(*letter))
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

    use super::{build, links};
    use std::fs;
    use std::path::Path;

    #[test]
    fn the_site_is_whole() {
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let folder = tempfile::tempdir().unwrap();
        assert!(build(&repository, folder.path()).unwrap() > 15);
        let page = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
        // README's links lead to pages, its picture is there, and chapters lead back.
        let first = page("index.html");
        for part in [
            "href=\"docs/concepts.html\"",
            "docs/same_second_dark.webp",
            "href=\"page/index.html\"",
        ] {
            assert!(first.contains(part), "{part}");
        }
        assert!(page("docs/numbers.html").contains("id=\"on-the-chip\""));
        assert!(page("docs/concepts.html").contains("href=\"../index.html\""));
        for picture in links(&fs::read_to_string(repository.join("README.md")).unwrap()) {
            if picture.ends_with(".webp") {
                assert!(folder.path().join(&picture).exists(), "{picture}");
            }
        }
    }

    #[test]
    fn a_link_that_leads_nowhere_is_named() {
        let repository = tempfile::tempdir().unwrap();
        fs::create_dir(repository.path().join("docs")).unwrap();
        fs::write(repository.path().join("docs/SUMMARY.md"), "# Summary\n").unwrap();
        fs::write(repository.path().join("README.md"), "# A\n\n[b](docs/b.md#c)\n").unwrap();
        let error = build(repository.path(), repository.path())
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "README.md: found docs/b.md#c, expected a link to a file of the repository"
        );
    }
}
