//! The key that signs tables.
//!
//! An image holds one public key; the secret one never comes near it. `FRESHLANE_TABLE_KEY`, 64 hexadecimal digits in the
//! environment of the build, is that key. Without it the image holds the **test key**, whose secret half is in the repository's
//! tests: everybody can sign for such an image. A key for which anybody could forge signatures, or nobody sign, fails the build. It says so in three places: a warning of the build, [`Key::IS_TEST`] with the
//! text [`Key::KIND`] in the image (`strings firmware | grep 'table key'`), and a line in the log (feature `defmt`) at every start.
//!
//! # Why salty
//! Signatures are checked by `salty`, which is made for this core and takes 14 KiB; ed25519-dalek takes 47, ed25519-compact 302,
//! of the image's 64. Its arithmetic does not depend on the data. Two things it accepts that [`Key::verifies`] does not: a scalar that is
//! not reduced, which would make a second signature from every first one; and a key of small order, under which a signature that anybody
//! can write fits most messages.

mod sound;

pub use sound::is_sound;

/// The lowest version that this image runs (chosen: 0 is for no version). Raise it to shut out all tables before one.
pub const MINIMUM_VERSION: u32 = 1;

/// The order of Ed25519's group, 2^252 + 27742317777372353535851937790883648493, from its last byte (RFC 8032 section 5.1).
const ORDER_FROM_LAST: [u8; 32] = [
    0x10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x14, 0xde, 0xf9, 0xde, 0xa2, 0xf7, 0x9c, 0xd6, 0x58,
    0x12, 0x63, 0x1a, 0x5c, 0xf5, 0xd3, 0xed,
];

/// A public key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key(pub [u8; 32]);

include!(concat!(env!("OUT_DIR"), "/table_key.rs"));

impl Key {
    /// The key of this image.
    pub const BUILT_IN: Self = Self(TABLE_KEY);
    /// Whether everybody knows the secret half of [`Key::BUILT_IN`].
    pub const IS_TEST: bool = TABLE_KEY_IS_TEST;
    /// The same in words, to be found in an image.
    pub const KIND: &'static str = if Self::IS_TEST {
        "table key: TEST, not for release"
    } else {
        "table key: release"
    };

    /// Whether `signature` is this key's on `message`.
    pub fn verifies(&self, message: &[u8], signature: &[u8; 64]) -> bool {
        let scalar = signature.last_chunk::<32>();
        let reduced = scalar.is_some_and(|scalar| scalar.iter().rev().lt(&ORDER_FROM_LAST));
        reduced && is_sound(&self.0) && self.equation_holds(message, signature)
    }

    #[cfg(not(feature = "no-panic-proof"))]
    fn equation_holds(&self, message: &[u8], signature: &[u8; 64]) -> bool {
        salty::PublicKey::try_from(&self.0)
            .is_ok_and(|key| key.verify(message, &salty::Signature::from(signature)).is_ok())
    }

    /// The proof image leaves salty out, whose indices the compiler cannot bound, and so accepts no package.
    #[cfg(feature = "no-panic-proof")]
    fn equation_holds(&self, _: &[u8], _: &[u8; 64]) -> bool {
        false
    }
}

/// Bytes of a [`Digest`].
pub const DIGEST_LEN: usize = 48;

/// A table's digest: the first bytes of its SHA-512, which the signature check brings along.
pub struct Digest(#[cfg(not(feature = "no-panic-proof"))] salty::Sha512);

#[cfg(not(feature = "no-panic-proof"))]
impl Digest {
    /// Of nothing yet.
    #[allow(clippy::new_without_default, reason = "a start, not a default")]
    pub fn new() -> Self {
        Self(salty::Sha512::new())
    }

    /// Takes in the next bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The digest.
    pub fn finish(self) -> [u8; DIGEST_LEN] {
        let digest: [u8; 64] = self.0.finalize();
        digest.first_chunk().copied().unwrap_or([0; DIGEST_LEN])
    }
}

/// The proof image has no salty, and so no digest either: it gets to none, since no signature holds.
#[cfg(feature = "no-panic-proof")]
#[allow(missing_docs, clippy::new_without_default, reason = "see the other form")]
impl Digest {
    pub const fn new() -> Self {
        Self()
    }

    pub const fn update(&mut self, _: &[u8]) {}

    pub const fn finish(self) -> [u8; DIGEST_LEN] {
        [0; DIGEST_LEN]
    }
}
