//! Keys for tables and images as PKCS#8 files, and packages signed with them.

use ed25519_dalek::pkcs8::spki::der::pem::LineEnding;
use ed25519_dalek::pkcs8::{DecodePrivateKey, EncodePrivateKey};
use ed25519_dalek::{Signer, SigningKey};
use firmware::table::Table;
use firmware::table_store::key::{DIGEST_LEN, Digest, MINIMUM_VERSION, is_sound};
use firmware::table_store::package::{Content, FORMAT, HEADER_LEN, Header, HeaderBytes, MAX_VERSION};
use firmware::table_store::{Key, MAX_TABLE};
use host_sim::image::{Image, RENEWABLE};
use kit::error::{Error, Result};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

/// The secret half of the key in images that were built without another: everybody knows it.
const TEST_SECRET: [u8; 32] = [0x42; 32];

/// Stands before a test key in its file, where readers of PEM skip it.
const TEST_MARK: &str = "TEST KEY: its secret half is published. Not for release.\n";
/// The first line of a PKCS#8 file in PEM.
const BEGIN: &str = "-----BEGIN PRIVATE KEY-----";

/// A secret key for tables.
#[derive(Debug)]
pub struct TableKey(SigningKey);

impl TableKey {
    /// A new one, from the system's randomness.
    ///
    /// # Errors
    /// A system without any.
    pub fn new() -> Result<Self> {
        let mut secret = [0; 32];
        getrandom::fill(&mut secret)
            .map_err(|error| Error::input("the system's randomness", error, "32 bytes of it"))?;
        Ok(Self(SigningKey::from_bytes(&secret)))
    }

    /// The one that everybody knows.
    pub fn test() -> Self {
        Self(SigningKey::from_bytes(&TEST_SECRET))
    }

    /// Reads a PKCS#8 file in PEM (RFC 8410).
    ///
    /// # Errors
    /// [`Error::File`], or [`Error::Input`] for a file that holds no such key.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::file(path, source))?;
        let refused = |found: &dyn std::fmt::Display| {
            Error::input(
                path.display(),
                found,
                "an Ed25519 key as PKCS#8 in PEM (`trainer key --out FILE` makes one)",
            )
        };
        let begin = text.find(BEGIN).ok_or_else(|| refused(&"no private key"))?;
        let key = SigningKey::from_pkcs8_pem(&text[begin..]).map_err(|error| refused(&error))?;
        Ok(Self(key))
    }

    /// Writes it to a new file that nobody else may read; a test key says there that it is one.
    ///
    /// # Errors
    /// [`Error::File`]; a file that exists is never replaced.
    pub fn write(&self, path: &Path) -> Result<()> {
        let pem = self
            .0
            .to_pkcs8_pem(LineEnding::LF)
            .map_err(|error| Error::input("key", error, "one that PKCS#8 holds"))?;
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|source| Error::file(folder, source))?;
        }
        let mut options = OpenOptions::new();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let mut file = options.open(path).map_err(|source| Error::file(path, source))?;
        let mark = if self.is_test() { TEST_MARK } else { "" };
        let written = file
            .write_all(mark.as_bytes())
            .and_then(|()| file.write_all(pem.as_bytes()))
            .and_then(|()| file.sync_all());
        written.map_err(|source| {
            drop(std::fs::remove_file(path));
            Error::file(path, source)
        })
    }

    /// Whether everybody knows it.
    pub fn is_test(&self) -> bool {
        self.0.as_bytes() == &TEST_SECRET
    }

    /// Its public half, as images hold it.
    pub fn public(&self) -> Key {
        Key(self.0.verifying_key().to_bytes())
    }

    /// The public half as `FRESHLANE_TABLE_KEY` takes it.
    pub fn public_text(&self) -> String {
        self.public().0.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// A package of this table under this version, checked as a unit with this key checks it.
    ///
    /// # Errors
    /// A version or a table that no unit takes.
    pub fn sign(&self, table: &Table<'_>, version: u32) -> Result<Vec<u8>> {
        if !(MINIMUM_VERSION..=MAX_VERSION).contains(&version) {
            let expected = format!("{MINIMUM_VERSION} to {MAX_VERSION}, above that of every table before");
            return Err(Error::input("--version", version, expected));
        }
        let table = table.bytes();
        if table.len() > MAX_TABLE {
            let (found, expected) = (table.len(), MAX_TABLE);
            return Err(Error::input(
                "table",
                format!("{found} bytes"),
                format!("at most {expected}, the room of a slot"),
            ));
        }
        self.package(Content::Table, table, version)
    }

    /// A package of this image, under the version that is in it.
    ///
    /// # Errors
    /// An image that no boot loader starts, or that names no version.
    pub fn sign_image(&self, image: &Image) -> Result<Vec<u8>> {
        let place = image.path().display();
        if image.start() != RENEWABLE {
            let expected = "one that a boot loader starts (`cargo build --bin renewable`)";
            return Err(Error::input(place, "an image that stands alone", expected));
        }
        let version = image.version()?;
        if version == 0 || version > MAX_VERSION {
            let expected = format!("1 to {MAX_VERSION}: build it with FRESHLANE_IMAGE_VERSION=NUMBER");
            return Err(Error::input(place, format!("version {version}"), expected));
        }
        self.package(Content::Image, image.flash(), version)
    }

    fn package(&self, kind: Content, content: &[u8], version: u32) -> Result<Vec<u8>> {
        let mut digest = Digest::new();
        digest.update(content);
        let digest: [u8; DIGEST_LEN] = digest.finish();
        let words = [FORMAT, version, content.len() as u32].map(u32::to_le_bytes);
        let mut package = [&kind.magic(), words.as_flattened(), &digest].concat();
        let signature = self.0.sign(&package);
        package.extend(signature.to_bytes());
        debug_assert_eq!(package.len(), HEADER_LEN);
        let header: Option<&HeaderBytes> = package.as_chunks().0.first_chunk();
        let sound = is_sound(&self.public().0);
        match header.map(|header| Header::check(header, kind, &self.public())) {
            Some(Ok(_)) if sound => {}
            outcome => {
                return Err(Error::input(
                    "package",
                    format!("{outcome:?}"),
                    "one that a unit with this key takes",
                ));
            }
        }
        package.extend(content);
        Ok(package)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware::tables::DISTILLED;

    #[test]
    fn packages_are_what_units_take_and_keys_survive_their_files() {
        let folder = tempfile::tempdir().unwrap();
        let table = Table::parse(DISTILLED).unwrap();
        for (name, key) in [
            ("test.pem", TableKey::test()),
            ("new.pem", TableKey::new().unwrap()),
        ] {
            let path = folder.path().join("keys").join(name);
            key.write(&path).unwrap();
            let text = std::fs::read_to_string(&path).unwrap();
            assert_eq!(text.contains("TEST KEY"), key.is_test());
            #[cfg(unix)]
            {
                let permissions =
                    std::os::unix::fs::PermissionsExt::mode(&path.metadata().unwrap().permissions());
                assert_eq!(permissions & 0o777, 0o600);
            }
            assert!(
                matches!(key.write(&path), Err(Error::File { .. })),
                "never replaced"
            );
            let read = TableKey::read(&path).unwrap();
            assert_eq!(read.public(), key.public());
            let package = read.sign(&table, 7).unwrap();
            assert_eq!(
                package,
                key.sign(&table, 7).unwrap(),
                "a signature depends on nothing else"
            );
            let header: &HeaderBytes = package.as_chunks().0.first_chunk().unwrap();
            let header = Header::check(header, Content::Table, &key.public()).unwrap();
            assert_eq!((header.version, header.length as usize), (7, DISTILLED.len()));
            assert_eq!(&package[HEADER_LEN..], DISTILLED);
            for version in [0, u32::MAX] {
                let text = key.sign(&table, version).unwrap_err().to_string();
                assert!(
                    text.starts_with(&format!("--version: found {version}, expected 1 to 4294967294")),
                    "{text}"
                );
            }
        }
        assert_eq!(TableKey::test().public(), Key::BUILT_IN);
        assert_ne!(
            TableKey::new().unwrap().public(),
            TableKey::new().unwrap().public()
        );
        let path = folder.path().join("none");
        for (text, found) in [
            ("", "no private key"),
            (
                "-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n",
                "",
            ),
            ("-----BEGIN PUBLIC KEY-----", "no private key"),
        ] {
            std::fs::write(&path, text).unwrap();
            let text = TableKey::read(&path).unwrap_err().to_string();
            assert!(
                text.contains(found) && text.contains("expected an Ed25519 key as PKCS#8 in PEM"),
                "{text}"
            );
        }
    }
}
