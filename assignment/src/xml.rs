//! A walk through the elements of an XML text that knows its lines.

use kit::error::{Error, Result};
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;

/// What the walk comes to.
pub(crate) enum Scan<'w> {
    /// An element begins.
    Open(&'w Element<'w>),
    /// An element of this name ends.
    Close(&'w str),
}

/// The start of an element.
pub(crate) struct Element<'w> {
    name: &'w str,
    line: usize,
    start: &'w BytesStart<'w>,
    tag: String,
}

/// Visits every element of `text`, whose root must be one of `roots`; `name` stands for the file in errors, which name the
/// first of them.
pub(crate) fn elements(
    name: &str,
    text: &str,
    roots: &[&str],
    visit: &mut dyn FnMut(Scan<'_>) -> Result<()>,
) -> Result<()> {
    let root = roots.first().copied().unwrap_or_default();
    let mut reader = Reader::from_str(text);
    let mut depth = 0_usize;
    let (mut counted, mut line) = (0, 1);
    let mut seen_root: Option<String> = None;
    loop {
        let position = usize::try_from(reader.buffer_position()).unwrap_or(text.len());
        let passed = text.as_bytes().get(counted..position).unwrap_or_default();
        line += passed.iter().filter(|byte| **byte == b'\n').count();
        counted = position;
        let event = reader.read_event().map_err(|failure| {
            let found = format!("broken XML ({failure})");
            Error::input(format!("{name}:{line}"), found, "well-formed XML")
        })?;
        let is_empty = matches!(event, Event::Empty(_));
        match event {
            Event::Start(start) | Event::Empty(start) => {
                let element = Element {
                    name,
                    line,
                    tag: start.name().as_ref().to_owned(),
                    start: &start,
                };
                if depth == 0 && (seen_root.is_some() || !roots.contains(&element.tag.as_str())) {
                    return Err(element.error(format!("<{}>", element.tag), format!("one <{root}>")));
                }
                if depth == 0 {
                    seen_root = Some(element.tag.clone());
                }
                visit(Scan::Open(&element))?;
                if is_empty {
                    visit(Scan::Close(&element.tag))?;
                } else {
                    depth += 1;
                }
            }
            Event::End(end) => {
                depth -= 1;
                visit(Scan::Close(end.name().as_ref()))?;
            }
            Event::Eof if depth > 0 || seen_root.is_none() => {
                let found = "the end of the file";
                let expected = seen_root.map_or(format!("<{root}>"), |root| format!("</{root}>"));
                return Err(Error::input(format!("{name}:{line}"), found, expected));
            }
            Event::Eof => return Ok(()),
            _ => {}
        }
    }
}

impl Element<'_> {
    /// Its name.
    pub(crate) fn tag(&self) -> &str {
        &self.tag
    }

    /// `FILE:LINE`.
    pub(crate) fn place(&self) -> String {
        format!("{}:{}", self.name, self.line)
    }

    pub(crate) fn error(&self, found: impl ToString, expected: impl ToString) -> Error {
        Error::input(self.place(), found, expected)
    }

    /// The value of an attribute that may be missing.
    pub(crate) fn optional(&self, attribute: &str) -> Result<Option<String>> {
        let broken = |failure: String| self.error(format!("broken XML ({failure})"), "well-formed XML");
        let mut value = None;
        // All attributes are gone through, so that one given twice is seen.
        for candidate in self.start.attributes() {
            let candidate = candidate.map_err(|failure| broken(failure.to_string()))?;
            if candidate.key.as_ref() == attribute {
                let text = candidate.normalized_value(XmlVersion::Implicit1_0);
                value = Some(text.map_err(|failure| broken(failure.to_string()))?.into_owned());
            }
        }
        Ok(value)
    }

    /// The value of an attribute that must be there.
    pub(crate) fn required(&self, attribute: &str) -> Result<String> {
        self.optional(attribute)?.ok_or_else(|| {
            let found = format!("<{}> without '{attribute}'", self.tag);
            self.error(found, format!("an attribute '{attribute}'"))
        })
    }

    /// A finite number above 0 that must be there.
    pub(crate) fn positive(&self, attribute: &str) -> Result<f64> {
        let text = self.required(attribute)?;
        let number = text.trim().parse::<f64>().ok();
        let usable = number.filter(|number| number.is_finite() && *number > 0.0);
        usable.ok_or_else(|| self.error(format!("{attribute}=\"{text}\""), "a positive number"))
    }

    /// A finite number, not negative, that may be missing.
    pub(crate) fn optional_amount(&self, attribute: &str) -> Result<Option<f64>> {
        let Some(text) = self.optional(attribute)? else {
            return Ok(None);
        };
        let number = text.trim().parse::<f64>().ok();
        let usable = number.filter(|number| number.is_finite() && *number >= 0.0);
        let expected = "a finite number, not negative";
        usable
            .map(Some)
            .ok_or_else(|| self.error(format!("{attribute}=\"{text}\""), expected))
    }
}
