//! Texts of files, plain or compressed by gzip.

use flate2::read::MultiGzDecoder;
use kit::error::{Error, Result};
use kit::files::Text;
use std::fs::File;
use std::io::{Chain, Cursor, ErrorKind, Read};
use std::path::Path;

/// The first two bytes of every gzip file (RFC 1952, section 2.3.1).
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Bytes that a compressed file may have when it is unpacked (chosen: four times the largest city's network in SUMO's
/// format; a small file can claim any size).
const LARGEST_UNPACKED: u64 = 2 << 30;

/// The text of a file without its byte-order mark; the file's content says whether it is compressed, not its name.
///
/// # Errors
/// [`Error::File`] if it cannot be read or is no UTF-8, and [`Error::Input`] for one that is larger than 2 GiB when unpacked.
pub fn read(path: &Path) -> Result<Text> {
    let failure = |source| Error::file(path, source);
    let mut file = File::open(path).map_err(failure)?;
    let mut magic = Vec::new();
    let _read = (&mut file)
        .take(GZIP_MAGIC.len() as u64)
        .read_to_end(&mut magic)
        .map_err(failure)?;
    let compressed = magic == GZIP_MAGIC;
    let whole: Chain<Cursor<Vec<u8>>, File> = Cursor::new(magic).chain(file);
    let mut text = String::new();
    if compressed {
        let unpacked = MultiGzDecoder::new(whole)
            .take(LARGEST_UNPACKED + 1)
            .read_to_string(&mut text)
            .map_err(|source| match source.kind() {
                ErrorKind::UnexpectedEof => {
                    Error::input(path.display(), "a truncated gzip file", "all of it")
                }
                _ => failure(source),
            })?;
        if unpacked as u64 > LARGEST_UNPACKED {
            let found = format!("more than {LARGEST_UNPACKED} bytes when unpacked");
            return Err(Error::input(path.display(), found, "a smaller file"));
        }
    } else {
        let mut whole = whole;
        let _read = whole.read_to_string(&mut text).map_err(failure)?;
    }
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    let name = path.display().to_string();
    Ok(Text { name, text })
}
