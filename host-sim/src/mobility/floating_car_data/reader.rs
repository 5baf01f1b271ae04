//! The XML of floating-car data, plain or compressed, read as a stream.

use super::Trace;
use super::builder::TraceBuilder;
use assignment::text::most_unpacked;
use flate2::bufread::MultiGzDecoder;
use kit::error::{Error, Result};
use quick_xml::XmlVersion;
use quick_xml::errors::{Error as XmlError, IllFormedError};
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The first two bytes of every gzip file (RFC 1952, section 2.3.1).
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Longest element or text, in bytes (chosen: a vehicle takes some hundred).
const LONGEST_EVENT: usize = 1 << 20;

impl Trace {
    /// Reads a trace from a file, plain or compressed by gzip; the file's content decides which, not its name.
    ///
    /// # Errors
    /// [`Error::File`] when the file cannot be opened; otherwise those of [`Trace::parse`].
    pub fn read(path: &Path) -> Result<Self> {
        let in_file = |source| Error::file(path, source);
        let mut file = File::open(path).map_err(in_file)?;
        let most = most_unpacked(&file).map_err(in_file)?;
        let mut magic = Vec::new();
        let _bytes_read = (&mut file)
            .take(GZIP_MAGIC.len() as u64)
            .read_to_end(&mut magic)
            .map_err(in_file)?;
        let compressed = magic == GZIP_MAGIC;
        let whole = BufReader::new(std::io::Cursor::new(magic).chain(file));
        let place_name = path.display().to_string();
        if compressed {
            let unpacked = Limited {
                inner: MultiGzDecoder::new(whole),
                left: most,
            };
            Self::parse(&place_name, BufReader::new(unpacked))
        } else {
            Self::parse(&place_name, whole)
        }
    }

    /// Parses a trace's XML. `place_name` is what errors call the text, usually its file's name.
    ///
    /// Persons and containers, which SUMO writes beside vehicles, are no vehicles and are left out; so are attributes
    /// other than `id`, `x`, `y` and `speed`. Any other unknown element is an error.
    ///
    /// # Errors
    /// [`Error::Input`] names the line, what stands there and what was expected.
    pub fn parse(place_name: &str, reader: impl BufRead) -> Result<Self> {
        let mut reader = Reader::from_reader(LineCounter {
            inner: reader,
            newlines: 0,
            event: 0,
        });
        let mut builder = TraceBuilder::new(place_name);
        let mut buffer = Vec::new();
        loop {
            // Markup begins where the last event ended, so this is its line even when it spans several.
            let line = reader.get_ref().newlines + 1;
            buffer.clear();
            reader.get_mut().event = 0;
            match reader.read_event_into(&mut buffer) {
                Ok(Event::Start(element)) => open(&mut builder, place_name, line, &element)?,
                Ok(Event::Empty(element)) => {
                    open(&mut builder, place_name, line, &element)?;
                    builder.close();
                }
                Ok(Event::End(_)) => builder.close(),
                Ok(Event::Eof) => return builder.finish(line),
                Ok(Event::Text(text)) => builder.text(line, &text)?,
                Ok(Event::CData(_)) => return Err(builder.unexpected(line, "character data")),
                Ok(Event::GeneralRef(_)) => return Err(builder.unexpected(line, "an entity")),
                Ok(Event::Decl(_) | Event::PI(_) | Event::Comment(_) | Event::DocType(_)) => {}
                Err(error) => return Err(malformed(place_name, line, &error)),
            }
        }
    }
}

/// Tells the builder of an element that begins.
fn open(builder: &mut TraceBuilder, name: &str, line: usize, element: &BytesStart<'_>) -> Result<()> {
    let attribute = |wanted: &str| {
        let mut value = None;
        // All attributes are gone through, so that one given twice is seen.
        for attribute in element.attributes() {
            let attribute = attribute.map_err(|error| malformed(name, line, &error.into()))?;
            if attribute.key.as_ref() == wanted {
                let text = attribute.normalized_value(XmlVersion::Implicit1_0);
                value = Some(text.map_err(|error| malformed(name, line, &error))?.into_owned());
            }
        }
        Ok(value)
    };
    builder.open(line, element.name().as_ref(), &attribute)
}

/// Gives so many bytes, and an error if there are more.
struct Limited<R> {
    inner: R,
    left: u64,
}

impl<R: Read> Read for Limited<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inner.read(into)?;
        self.left = self
            .left
            .checked_sub(count as u64)
            .ok_or_else(|| std::io::Error::other("it unpacks to more than a hundred times its size"))?;
        Ok(count)
    }
}

/// Counts the newlines of what has been consumed, so that an error can name a line without keeping the text; refuses markup and
/// text that no end is in sight of.
struct LineCounter<R> {
    inner: R,
    newlines: usize,
    /// Bytes of the present event.
    event: usize,
}

impl<R: BufRead> Read for LineCounter<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inner.read(into)?;
        self.newlines += into.iter().take(count).filter(|byte| **byte == b'\n').count();
        Ok(count)
    }
}

impl<R: BufRead> BufRead for LineCounter<R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        if self.event > LONGEST_EVENT {
            let what = format!("an element or a text of more than {LONGEST_EVENT} bytes");
            return Err(std::io::Error::other(what));
        }
        self.inner.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        // What is consumed is still buffered, so this reads nothing and cannot fail.
        if count > 0
            && let Ok(buffered) = self.inner.fill_buf()
        {
            self.newlines += buffered.iter().take(count).filter(|byte| **byte == b'\n').count();
        }
        self.event += count;
        self.inner.consume(count);
    }
}

/// What is wrong with the XML itself.
fn malformed(name: &str, line: usize, error: &XmlError) -> Error {
    let (found, expected) = match error {
        XmlError::Io(error) => (
            format!("unreadable data ({error})"),
            "a whole, undamaged file".to_owned(),
        ),
        XmlError::Syntax(error) => (format!("broken XML ({error})"), "well-formed XML".to_owned()),
        XmlError::IllFormed(IllFormedError::MismatchedEndTag { expected, found }) => {
            (format!("</{found}>"), format!("</{expected}>"))
        }
        XmlError::Encoding(_) => ("bytes that are not UTF-8".to_owned(), "UTF-8 text".to_owned()),
        other => (format!("broken XML ({other})"), "well-formed XML".to_owned()),
    };
    Error::input(format!("{name}:{line}"), found, expected)
}
