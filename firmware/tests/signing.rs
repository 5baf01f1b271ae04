//! Signs table packages with the test key. A release key never comes near this code.

use salty::Keypair;

/// The secret half of the **test key**. Everybody knows it; an image that trusts it says so.
pub const TEST_SECRET: [u8; 32] = [0x42; 32];

/// A package as the layout in `firmware::table_store::package` says, signed with this secret key.
pub fn package(table: &[u8], version: u32, secret: &[u8; 32]) -> Vec<u8> {
    let mut bytes = b"FLPK".to_vec();
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend(version.to_le_bytes());
    bytes.extend(u32::try_from(table.len()).unwrap().to_le_bytes());
    bytes.extend(table);
    let signature = Keypair::from(secret).sign(&bytes).to_bytes();
    bytes.extend(signature);
    bytes
}

/// The same as it lies in an active slot.
pub fn slot(package: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xff; 16 << 10];
    bytes[..4].copy_from_slice(b"LIVE");
    bytes[16..16 + package.len()].copy_from_slice(package);
    bytes
}

/// The public half of a secret key.
pub fn public(secret: &[u8; 32]) -> [u8; 32] {
    *Keypair::from(secret).public.as_bytes()
}
