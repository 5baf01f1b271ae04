//! Logging is live with the feature: what a unit reports reaches the logger.

use crate::host_logger::logged;
use firmware::lots::Identity;
use firmware::unit::Unit;

#[test]
fn a_damaged_table_is_logged() {
    let (frames, bytes) = logged();
    let unit = Unit::new(b"no table", Identity(0));
    assert!(unit.table().is_err());
    let (frames_after, bytes_after) = logged();
    assert!(frames_after > frames, "no log frame");
    assert!(
        bytes_after > bytes + 2,
        "{} bytes: not even an index and a reason",
        bytes_after - bytes
    );
}
