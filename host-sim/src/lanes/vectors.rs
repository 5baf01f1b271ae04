//! The machine's vector unit, chosen at run time.

use kit::error::{Error, Result};
use std::sync::OnceLock;

/// The environment variable that names the vector unit to use instead of the widest one.
const VARIABLE: &str = "FRESHLANE_VECTORS";

/// The vector unit that loops over rows are compiled for, and the way in which dense layers multiply there. The bytes are the
/// same on all.
#[derive(Clone, Copy, Debug)]
pub struct Vectors {
    name: &'static str,
    /// None: what every machine of the architecture has.
    pub(super) unit: Option<pulp::Arch>,
    /// Instructions that multiply and add four bytes in a lane, where there are any.
    pub(super) bytes: Option<Bytes>,
}

/// Instructions that multiply and add four bytes in a lane.
#[cfg(target_arch = "x86_64")]
pub(super) type Bytes = super::units::x86::Bytes;
#[cfg(target_arch = "aarch64")]
pub(super) type Bytes = super::units::arm::NeonBytes;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
pub(super) type Bytes = std::convert::Infallible;

impl Vectors {
    /// The widest one that this machine has, or the one that `FRESHLANE_VECTORS` names.
    pub fn widest() -> Self {
        static CHOSEN: OnceLock<Vectors> = OnceLock::new();
        *CHOSEN.get_or_init(|| Self::chosen().unwrap_or_else(|_| Self::machine()))
    }

    /// What every machine of the architecture has, for comparison.
    pub const fn plain() -> Self {
        Self {
            name: "plain",
            unit: None,
            bytes: None,
        }
    }

    /// All that this machine has, the plainest first.
    pub fn all() -> Vec<Self> {
        #[allow(unused_mut, reason = "some architectures have no vectors")]
        let mut all = vec![Self::plain()];
        #[cfg(target_arch = "x86_64")]
        {
            use super::units::x86::{Bytes256, Bytes512};
            let units = [
                pulp::x86::V3::try_new().map(|unit| {
                    let bytes = Bytes256::new(unit).map(Bytes::Ymm);
                    ("avx2", "avx2-vnni", pulp::Arch::V3(unit), bytes)
                }),
                pulp::x86::V4::try_new().map(|unit| {
                    let bytes = Bytes512::new(unit).map(Bytes::Zmm);
                    ("avx512", "avx512-vnni", pulp::Arch::V4(unit), bytes)
                }),
            ];
            for (name, with_bytes, unit, bytes) in units.into_iter().flatten() {
                all.push(Self::of(name, unit, None));
                all.extend(bytes.map(|bytes| Self::of(with_bytes, unit, Some(bytes))));
            }
        }
        #[cfg(target_arch = "aarch64")]
        if let Some(neon) = pulp::aarch64::Neon::try_new() {
            let (unit, bytes) = (pulp::Arch::Neon(neon), Bytes::new(neon));
            all.push(Self::of("neon", unit, None));
            all.extend(bytes.map(|bytes| Self::of("neon-dotprod", unit, Some(bytes))));
        }
        #[cfg(target_arch = "wasm32")]
        if let Some(unit) = pulp::wasm::Simd128::try_new() {
            all.push(Self::of("simd128", pulp::Arch::Simd128(unit), None));
        }
        all
    }

    #[allow(dead_code, reason = "some architectures have no vectors")]
    fn of(name: &'static str, unit: pulp::Arch, bytes: Option<Bytes>) -> Self {
        Self {
            name,
            unit: Some(unit),
            bytes,
        }
    }

    /// The last of all.
    fn machine() -> Self {
        Self::all().pop().unwrap_or(Self::plain())
    }

    /// What `FRESHLANE_VECTORS` names, for comparing and for machines whose widest unit is not their fastest; the widest without it.
    ///
    /// # Errors
    /// [`Error::Input`] with the names of all if this machine has none of that name.
    pub fn chosen() -> Result<Self> {
        let Some(name) = std::env::var_os(VARIABLE) else {
            return Ok(Self::machine());
        };
        let all = Self::all();
        let found = all.iter().find(|vectors| *vectors.name == *name);
        found.copied().ok_or_else(|| {
            let names: Vec<String> = all
                .iter()
                .map(|vectors| format!("\"{}\"", vectors.name))
                .collect();
            Error::input(VARIABLE, format!("{name:?}"), names.join(", "))
        })
    }

    /// What people call it.
    pub fn name(self) -> &'static str {
        self.name
    }

    /// Runs `loops` on it. Whatever `loops` calls has to be inlined to profit.
    #[inline(always)]
    pub fn run<R>(self, loops: impl FnOnce() -> R) -> R {
        match self.unit {
            Some(unit) => unit.dispatch(loops),
            None => loops(),
        }
    }
}
