//! `trainer sign`: a table or an image as a package that units take over the air.

use crate::signing::TableKey;
use host_sim::image::Image;
use host_sim::weight_table::WeightTable;
use kit::error::Result;
use kit::files::{check_output, write_whole};
use kit::{say, tell};
use serde_json::json;
use std::path::PathBuf;

/// Options of `sign`.
#[derive(Clone, Debug, clap::Args)]
pub struct SignArguments {
    /// File of the secret key: PKCS#8 in PEM
    #[arg(long, value_name = "FILE")]
    pub key: PathBuf,
    /// Version of the table, above that of every table that was signed with the key before
    #[arg(long, value_name = "NUMBER", required_unless_present = "image")]
    pub version: Option<u32>,
    /// The table [default: the one that is built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// An image to sign instead: the ELF file of the firmware's program `renewable`, whose build named its version
    #[arg(long, value_name = "ELF", conflicts_with_all = ["table", "version"])]
    pub image: Option<PathBuf>,
    /// Where to write the package
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Signs, and reports.
///
/// # Errors
/// A key or a table that cannot be read, a version that no unit takes, a file that cannot be written.
pub fn run(arguments: &SignArguments) -> Result<()> {
    let contents = arguments.table.iter().chain(&arguments.image);
    let inputs: Vec<PathBuf> = contents.chain([&arguments.key]).cloned().collect();
    check_output("--out", &arguments.out, &inputs)?;
    let key = TableKey::read(&arguments.key)?;
    let (package, version) = if let Some(path) = &arguments.image {
        let image = Image::read(path)?;
        (key.sign_image(&image)?, image.version()?)
    } else {
        let table = WeightTable::read_or_built_in(arguments.table.as_deref())?;
        // Clap asks for it.
        let version = arguments.version.unwrap_or_default();
        (key.sign(&table.parse()?, version)?, version)
    };
    write_whole(&arguments.out, &package)?;
    if arguments.json {
        say!(
            "{}",
            json!({
                "package": arguments.out,
                "package_bytes": package.len(),
                "version": version,
                "public_key": key.public_text(),
                "test_key": key.is_test(),
            })
        );
    } else {
        let with = if key.is_test() {
            "the TEST key, not for release"
        } else {
            "the key"
        };
        tell!(
            "Wrote {}, {} bytes: version {version}, signed with {with} {}.",
            arguments.out.display(),
            package.len(),
            key.public_text()
        );
    }
    Ok(())
}
