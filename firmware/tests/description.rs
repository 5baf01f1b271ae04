//! The binary on a host describes the table that is built into the image.

use firmware::table::Table;
use firmware::tables::DISTILLED;
use std::process::Command;

#[test]
fn the_host_binary_describes_the_table_or_says_what_is_wrong() {
    let output = Command::new(env!("CARGO_BIN_EXE_firmware")).output().unwrap();
    let (printed, complaint) = (
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    );
    match Table::parse(DISTILLED) {
        Ok(table) => {
            assert!(output.status.success(), "{complaint}");
            let size = format!("{} bytes", table.bytes().len());
            let seed = table.provenance().seed.to_string();
            let widths: Vec<String> = table.network().widths().map(|width| width.to_string()).collect();
            let geometry = format!("geometry            {} (", widths.join("-"));
            for part in [&*geometry, &size, &seed, "required SINR"] {
                assert!(printed.contains(part), "{part:?} is missing in\n{printed}");
            }
        }
        Err(error) => {
            assert!(!output.status.success(), "a unit would refuse the table");
            assert!(complaint.contains(&error.to_string()), "{complaint}");
        }
    }
}
