//! `trainer key`: a key for signing tables, or what an image needs to know of one.

use crate::signing::TableKey;
use kit::error::Result;
use kit::say;
use serde_json::json;
use std::path::PathBuf;

/// Options of `key`.
#[derive(Clone, Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("source").required(true).multiple(false)))]
pub struct KeyArguments {
    /// Make a new secret key and write it to this file, which must not exist: PKCS#8 in PEM
    #[arg(long, value_name = "FILE", group = "source")]
    pub out: Option<PathBuf>,
    /// Read the secret key in this file
    #[arg(long, value_name = "FILE", group = "source")]
    pub of: Option<PathBuf>,
    /// Write the key that everybody knows, for images that were built without another
    #[arg(long, requires = "out")]
    pub test: bool,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Makes or reads a key and prints its public half.
///
/// # Errors
/// A file that cannot be read or written, or that holds no key.
pub fn run(arguments: &KeyArguments) -> Result<()> {
    let key = match (&arguments.of, &arguments.out) {
        (Some(path), _) => TableKey::read(path)?,
        (None, path) => {
            let key = if arguments.test {
                TableKey::test()
            } else {
                TableKey::new()?
            };
            if let Some(path) = path {
                key.write(path)?;
            }
            key
        }
    };
    let public = key.public_text();
    if arguments.json {
        say!("{}", json!({ "public_key": public, "test_key": key.is_test() }));
    } else {
        if key.is_test() {
            say!("The TEST key, not for release: everybody can sign with it.");
        }
        say!("Images that take its tables are built with FRESHLANE_TABLE_KEY={public}");
    }
    Ok(())
}
