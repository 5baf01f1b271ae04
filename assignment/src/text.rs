//! Texts of files, plain or compressed by gzip.

use flate2::read::MultiGzDecoder;
use kit::error::{Error, Result};
use kit::files::Text;
use std::fs::File;
use std::io::{Chain, Cursor, ErrorKind, Read};
use std::path::Path;

/// The first two bytes of every gzip file (RFC 1952, section 2.3.1).
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// How many times its size a compressed file may have when it is unpacked (chosen: networks and traces have up to 30; a file can
/// claim a thousand).
const LARGEST_RATIO: u64 = 100;

/// Bytes that any compressed file may have when it is unpacked (chosen).
const ALWAYS_UNPACKED: u64 = 16 << 20;

/// Most bytes that a compressed file is unpacked to, by its size.
pub fn most_unpacked(file: &File) -> std::io::Result<u64> {
    let packed = file.metadata()?.len();
    Ok(packed
        .saturating_mul(LARGEST_RATIO)
        .saturating_add(ALWAYS_UNPACKED))
}

/// The text of a file without its byte-order mark; the file's content says whether it is compressed, not its name.
///
/// # Errors
/// [`Error::File`] if it cannot be read, and [`Error::Input`] for one that is no UTF-8, or more than a hundred times larger when
/// unpacked.
pub fn read(path: &Path) -> Result<Text> {
    let failure = |source| Error::file(path, source);
    let mut file = File::open(path).map_err(failure)?;
    let most = most_unpacked(&file).map_err(failure)?;
    let mut magic = Vec::new();
    let _read = (&mut file)
        .take(GZIP_MAGIC.len() as u64)
        .read_to_end(&mut magic)
        .map_err(failure)?;
    let compressed = magic == GZIP_MAGIC;
    let mut whole: Chain<Cursor<Vec<u8>>, File> = Cursor::new(magic).chain(file);
    let mut bytes = Vec::new();
    if compressed {
        let unpacked = MultiGzDecoder::new(whole)
            .take(most + 1)
            .read_to_end(&mut bytes)
            .map_err(|source| match source.kind() {
                ErrorKind::UnexpectedEof => {
                    Error::input(path.display(), "a truncated gzip file", "all of it")
                }
                _ => failure(source),
            })?;
        if unpacked as u64 > most {
            let found = format!("more than {most} bytes when unpacked");
            let expected = format!("at most {LARGEST_RATIO} times the file's size");
            return Err(Error::input(path.display(), found, expected));
        }
    } else {
        let _read = whole.read_to_end(&mut bytes).map_err(failure)?;
    }
    Text::decode(path.display().to_string(), bytes)
}
