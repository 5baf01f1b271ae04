//! Signs table packages with the test key. A release key never comes near this code.

use salty::{Keypair, Sha512};

/// The secret half of the **test key**. Everybody knows it; an image that trusts it says so.
pub const TEST_SECRET: [u8; 32] = [0x42; 32];

/// A package as the layout in `firmware::table_store::package` says, signed with this secret key.
pub fn package(table: &[u8], version: u32, secret: &[u8; 32]) -> Vec<u8> {
    package_of(u32::try_from(table.len()).unwrap(), table, version, secret)
}

/// A package with an image.
pub fn image_package(image: &[u8], version: u32, secret: &[u8; 32]) -> Vec<u8> {
    let length = u32::try_from(image.len()).unwrap();
    signed(*b"FLIM", length, image, version, secret)
}

/// A table's package with a header that states this length.
pub fn package_of(length: u32, table: &[u8], version: u32, secret: &[u8; 32]) -> Vec<u8> {
    signed(*b"FLPK", length, table, version, secret)
}

fn signed(magic: [u8; 4], length: u32, table: &[u8], version: u32, secret: &[u8; 32]) -> Vec<u8> {
    let mut bytes = magic.to_vec();
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend(version.to_le_bytes());
    bytes.extend(length.to_le_bytes());
    let digest: [u8; 64] = Sha512::new().updated(table).finalize();
    bytes.extend(&digest[..48]);
    let signature = Keypair::from(secret).sign(&bytes).to_bytes();
    bytes.extend(signature);
    bytes.extend(table);
    bytes
}

/// The same as it lies in a slot, complete and confirmed.
pub fn slot(package: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xff; 16 << 10];
    let (header, table) = package.split_at(128);
    for mark in [0, 128] {
        bytes[mark..mark + 32].fill(0x5a);
    }
    bytes[256..256 + header.len()].copy_from_slice(header);
    bytes[384..384 + table.len()].copy_from_slice(table);
    bytes
}

/// The public half of a secret key.
pub fn public(secret: &[u8; 32]) -> [u8; 32] {
    *Keypair::from(secret).public.as_bytes()
}
