//! The weight-table format: one frozen network with its geometry, scales and provenance, protected by a CRC-32 and
//! read in place from flash.
//!
//! # Layout
//! Little-endian throughout; offsets in bytes.
//!
//! | offset | type | field |
//! |---|---|---|
//! | 0 | 4 bytes | magic `FLAT` |
//! | 4 | u16 | version, 3 |
//! | 6 | u8 | number of dense layers, 1 to [`MAX_LAYERS`] |
//! | 7 | u8 | most sub-channels of a cell that it serves |
//! | 8 | u32 | length of the whole table with its checksum |
//! | 12 | u16 | most vehicles in the cell it was trained for, 1 to [`MAX_PLACES`] |
//! | 14 | i16 | required SINR in 1/256 dB, [`SINR`] |
//! | 16 | 2 bytes | 0 |
//! | 18 | 4 x i16 | joiner levels in 1/256 dB over noise, from the required SINR on and none below the one before |
//! | 26 | u8 | what the network sees: code of an [`ObservationForm`] |
//! | 27 | u8 | what its outputs mean: code of an [`OutputForm`] |
//! | 28 | 5 x u16 | widths: inputs, then each layer's outputs; unused ones 0 |
//! | 38 | u8 | 1 if the sources had uncommitted changes, else 0 |
//! | 39 | u8 | 0 |
//! | 40 | u64 | training seed |
//! | 48 | 20 bytes | digest of the sources that trained it (zeros if unknown) |
//! | 68 | 5 x u32 | scale of the inputs, then of each layer's outputs: the real value of one step, in 2^-24; unused ones 0 |
//! | 88 | layers | each: an i32 bias for every row of the stream, then the stream |
//! | length - 4 | u32 | CRC-32/ISO-HDLC of everything before |
//!
//! The scales are for people and tools; inference needs the multipliers alone ([`DenseLayer`](crate::network::DenseLayer)). But what
//! [`OutputForm::SubChannelAndPower`] makes of outputs needs their scale, so only 1/[`CONTINUOUS_ONE`] is accepted there.
//!
//! No field says a power in dBm, so no table can raise one: what a vehicle may send with, its measurement says ([`POWER_CEILING`](crate::decision::POWER_CEILING)).
//!
//! # Stream
//! The weights lie in the order in which the Cortex-M4's kernel uses them (`network/kernel.rs` explains why), and in no other
//! form: two forms could contradict each other and would double the flash. Rows are padded to a multiple of 8, those
//! of the last layer to a multiple of 4, and columns to a multiple of 8, all with zeros: biases, multipliers and
//! weights. Every four rows `r` to `r + 3` make a quad of `columns + 8` words:
//!
//! | words | content |
//! |---|---|
//! | 4 | for the pairs `r`, `r + 1` and `r + 2`, `r + 3` of an even and an odd row: 256 x even bias + odd bias, modulo 2^32; then odd bias - sum over every four columns of (w0 w2 + w1 w3) of the odd row |
//! | `columns` | for every four columns: 4 x i16 for the first pair, 4 x i16 for the second, each 256 x even weight + odd weight |
//! | 4 | i32 multipliers of the four rows |
//!
//! So an even row's weight cannot be -128 beside a negative one in the odd row. An even row's accumulator must stay in
//! -2^23 to 2^23 - 1 for all activations (-128 to 127 in the first layer, 0 to 255 in the others). For biases of 0 and
//! weights up to 127 that is so for any row of up to 259 hidden inputs; the trainer's export says which row of a wider one
//! does not fit.

use crate::decision::{JOINER_LEVELS, PowerPlan};
use crate::form::{CONTINUOUS_ONE, ObservationForm, OutputForm};
use crate::network::{MAX_LAYERS, MAX_WIDTH, Network, ReadError};
use crate::observation::PAPER_SUB_CHANNELS;
use crate::ring::MAX_PLACES;
use crate::units::{Level, MAX_SUB_CHANNELS, SubChannels};
use core::fmt::{Display, Formatter, from_fn};
use crc::{CRC_32_ISO_HDLC, Crc};

/// First bytes of a table.
pub const MAGIC: [u8; 4] = *b"FLAT";
/// The format's version.
pub const VERSION: u16 = 3;
/// Bytes before the first layer.
pub const HEADER_LEN: usize = 88;

/// Required SINR that makes sense, in 1/256 dB (chosen: -20 dB is far below what narrow-band codes reach, 60 dB above any constellation).
pub const SINR: core::ops::RangeInclusive<i16> = -20 * 256..=60 * 256;

/// Scale of outputs of [`OutputForm::SubChannelAndPower`].
const CONTINUOUS_SCALE: i32 = (1 << 24) / CONTINUOUS_ONE;

/// The table's checksum, and the frames'. One place for its own table, of which a constant would have many.
pub static CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Bytes aligned to a word, as a table must lie in memory.
///
/// ```
/// use firmware::table::Aligned;
///
/// const FILE: &[u8; 5] = b"bytes"; // in a program: include_bytes!("table.bin")
/// static TABLE: Aligned<{ FILE.len() }> = Aligned(*FILE);
/// assert_eq!(TABLE.0, *FILE);
/// ```
#[repr(C, align(4))]
#[derive(Debug)]
pub struct Aligned<const LEN: usize>(pub [u8; LEN]);

/// Where a table comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Provenance {
    /// The seed it was trained with.
    pub seed: u64,
    /// Digest of the sources that trained it, the first bytes of a SHA-256; zeros if unknown.
    pub revision: [u8; 20],
    /// Whether those sources had uncommitted changes.
    pub modified: bool,
}

/// Why bytes are no usable table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum TableError {
    /// The first four bytes are not [`MAGIC`].
    Magic([u8; 4]),
    /// A version this firmware does not read.
    Version(u16),
    /// The length field does not match the bytes.
    Length {
        /// What the header says.
        header: u32,
        /// Bytes there are.
        found: u32,
    },
    /// The checksum does not match: the table is damaged.
    Checksum {
        /// What the table says.
        stored: u32,
        /// What its bytes give.
        computed: u32,
    },
    /// The bytes do not begin at a word. The kernel loads words, so on a processor that has it such a table would be seven times slower.
    Alignment {
        /// Bytes past a word's boundary.
        past: u8,
    },
    /// Shorter than a header, a checksum and the layers, or a field that does not fit.
    Read(ReadError),
}

impl From<ReadError> for TableError {
    fn from(error: ReadError) -> Self {
        Self::Read(error)
    }
}

impl TableError {
    /// The field that does not fit.
    pub const fn field_name(&self) -> &'static str {
        match self {
            Self::Magic(_) => "magic",
            Self::Version(_) => "version",
            Self::Length { .. } => "length",
            Self::Checksum { .. } => "checksum",
            Self::Alignment { .. } => "alignment",
            Self::Read(ReadError::Truncated { .. }) => "truncated",
            Self::Read(ReadError::Field { name, .. }) => name,
        }
    }

    /// What stands there.
    pub fn found(&self) -> impl Display {
        from_fn(move |formatter| match self {
            Self::Magic(found) => write!(formatter, "{found:02x?}"),
            Self::Version(found) => write!(formatter, "{found}"),
            Self::Length { found, .. } | Self::Read(ReadError::Truncated { found, .. }) => {
                write!(formatter, "{found} bytes")
            }
            Self::Checksum { computed, .. } => write!(formatter, "{computed:#010x}"),
            Self::Alignment { past } => write!(formatter, "bytes that begin {past} behind a word's boundary"),
            Self::Read(ReadError::Field { found, .. }) => write!(formatter, "{found}"),
        })
    }

    /// What should stand there.
    pub fn expected(&self) -> impl Display {
        from_fn(move |formatter| match self {
            Self::Magic(_) => write!(formatter, "{MAGIC:02x?} (FLAT)"),
            Self::Version(_) => write!(formatter, "{VERSION}"),
            Self::Length { header, .. } => write!(formatter, "{header} as the header says"),
            Self::Checksum { stored, .. } => {
                write!(formatter, "{stored:#010x} as stored: the table is damaged")
            }
            Self::Alignment { .. } => formatter.write_str("some that begin at a word, as in table::Aligned"),
            Self::Read(ReadError::Truncated { expected, .. }) => write!(formatter, "at least {expected}"),
            Self::Read(ReadError::Field { expected, .. }) => write!(formatter, "{expected}"),
        })
    }
}

impl Display for TableError {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> core::fmt::Result {
        let (name, found, expected) = (self.field_name(), self.found(), self.expected());
        write!(formatter, "{name}: found {found}, expected {expected}")
    }
}

impl core::error::Error for TableError {}

/// A checked table. Copies nothing: the layers point into the bytes.
///
/// ```
/// use firmware::table::Table;
///
/// let table = Table::parse(firmware::tables::DISTILLED)?;
/// assert!(table.max_vehicles() >= 20);
/// let cut = &firmware::tables::DISTILLED[..100];
/// assert!(Table::parse(cut).is_err());
/// # Ok::<(), firmware::table::TableError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Table<'t> {
    network: Network<'t>,
    scales: [u32; MAX_LAYERS + 1],
    observation_form: ObservationForm,
    output_form: OutputForm,
    max_vehicles: u16,
    max_sub_channels: SubChannels,
    required_sinr: Level,
    power_plan: PowerPlan,
    provenance: Provenance,
    bytes: &'t [u8],
}

impl<'t> Table<'t> {
    /// Checks `bytes`, which begin at a word ([`Aligned`]), and reads them in place.
    ///
    /// # Errors
    /// [`TableError`] names the first field that does not fit. Nothing past the checksum is trusted before it matches.
    #[inline(never)]
    pub fn parse(bytes: &'t [u8]) -> Result<Self, TableError> {
        let length = bytes.len() as u32;
        let truncated = ReadError::Truncated {
            found: length,
            expected: HEADER_LEN.saturating_add(4) as u32,
        };
        let (body, checksum) = bytes.split_last_chunk::<4>().ok_or(truncated)?;
        if body.len() < HEADER_LEN {
            return Err(truncated.into());
        }
        let past = (bytes.as_ptr().addr() & 3) as u8;
        if past > 0 {
            return Err(TableError::Alignment { past });
        }
        let mut reader = Reader { rest: body };
        let magic = reader.array::<4>()?;
        if magic != MAGIC {
            return Err(TableError::Magic(magic));
        }
        let version = reader.u16()?;
        if version != VERSION {
            return Err(TableError::Version(version));
        }
        let [layers, sub_channels] = reader.array()?;
        let header = reader.u32()?;
        if header != length {
            return Err(TableError::Length {
                header,
                found: length,
            });
        }
        let (stored, computed) = (u32::from_le_bytes(*checksum), CHECKSUM.checksum(body));
        if stored != computed {
            return Err(TableError::Checksum { stored, computed });
        }

        let sub_channels = SubChannels::new(usize::from(sub_channels)).ok_or(ReadError::field(
            "sub_channels",
            i32::from(sub_channels),
            MAX_SUB_CHANNELS as i32,
        ))?;
        if layers == 0 || usize::from(layers) > MAX_LAYERS {
            return Err(ReadError::field("layers", i32::from(layers), MAX_LAYERS as i32).into());
        }
        let max_vehicles = reader.u16()?;
        within("vehicles", max_vehicles.into(), 1, MAX_PLACES.into())?;
        let required_sinr = reader.level()?;
        within(
            "required SINR",
            required_sinr.to_bits().into(),
            (*SINR.start()).into(),
            (*SINR.end()).into(),
        )?;
        expect("reserved", i32::from(reader.u16()?), 0)?;
        let mut joiner_levels = [Level::ZERO; JOINER_LEVELS];
        let mut least = required_sinr;
        for level in &mut joiner_levels {
            *level = reader.level()?;
            within(
                "joiner level",
                level.to_bits().into(),
                least.to_bits().into(),
                i16::MAX.into(),
            )?;
            least = *level;
        }
        let [observation_form, output_form] = reader.array()?;
        let observation_form = form("observation form", &ObservationForm::ALL, observation_form)?;
        let output_form = form("output form", &OutputForm::ALL, output_form)?;
        let mut widths = [0_usize; MAX_LAYERS + 1];
        for (index, width) in widths.iter_mut().enumerate() {
            *width = usize::from(reader.u16()?);
            let used = index <= usize::from(layers);
            if *width > MAX_WIDTH || (*width > 0) != used {
                return Err(ReadError::field(
                    "width",
                    *width as i32,
                    if used { MAX_WIDTH as i32 } else { 0 },
                )
                .into());
            }
        }
        let [modified, reserved] = reader.array()?;
        if modified > 1 {
            return Err(ReadError::field("modified", i32::from(modified), 1).into());
        }
        expect("reserved", i32::from(reserved), 0)?;
        let seed = u64::from_le_bytes(reader.array()?);
        let revision = reader.array()?;
        let mut scales = [0; MAX_LAYERS + 1];
        for (index, scale) in scales.iter_mut().enumerate() {
            *scale = reader.u32()?;
            let used = index <= usize::from(layers);
            if (*scale > 0) != used {
                return Err(ReadError::field("scale", scale.cast_signed(), used.into()).into());
            }
        }

        let (used, _) = widths
            .split_at_checked(usize::from(layers).saturating_add(1))
            .unwrap_or((&widths, &[]));
        let network = Network::parse(used, reader.rest)?;
        let [inputs, ..] = widths;
        expect("inputs", inputs as i32, observation_form.inputs() as i32)?;
        expect(
            "outputs",
            network.output_layer().geometry().outputs as i32,
            output_form.outputs() as i32,
        )?;
        if output_form == OutputForm::SubChannelAndPower {
            let scale = scales.get(usize::from(layers)).copied().unwrap_or(0);
            expect("output scale", scale.cast_signed(), CONTINUOUS_SCALE)?;
        }
        Ok(Self {
            network,
            scales,
            observation_form,
            output_form,
            max_vehicles,
            max_sub_channels: sub_channels,
            required_sinr,
            power_plan: PowerPlan { joiner_levels },
            provenance: Provenance {
                seed,
                revision,
                modified: modified == 1,
            },
            bytes,
        })
    }

    /// The network.
    pub const fn network(&self) -> &Network<'t> {
        &self.network
    }

    /// The real value of one step of the inputs, then of each layer's outputs, in 2^-24; unused ones are 0.
    pub const fn scales(&self) -> &[u32; MAX_LAYERS + 1] {
        &self.scales
    }

    /// The most vehicles in a cell that the network was trained for.
    pub const fn max_vehicles(&self) -> u16 {
        self.max_vehicles
    }

    /// The most sub-channels of a cell that the network was trained for.
    pub const fn max_sub_channels(&self) -> SubChannels {
        self.max_sub_channels
    }

    /// Whether the network can decide in a cell of so many sub-channels: in any up to [`Table::max_sub_channels`], or in those of
    /// [`PAPER_SUB_CHANNELS`] alone if it sees or chooses them one by one.
    pub fn serves(&self, sub_channels: SubChannels) -> bool {
        let any = self.observation_form == ObservationForm::Ring && self.output_form == OutputForm::Actions;
        if any {
            sub_channels.count() <= self.max_sub_channels.count()
        } else {
            sub_channels.count() == PAPER_SUB_CHANNELS
        }
    }

    /// The level at which a lone transmission succeeds.
    pub const fn required_sinr(&self) -> Level {
        self.required_sinr
    }

    /// What the network sees.
    pub const fn observation_form(&self) -> ObservationForm {
        self.observation_form
    }

    /// What the network's outputs mean.
    pub const fn output_form(&self) -> OutputForm {
        self.output_form
    }

    /// How the network's actions become power.
    pub const fn power_plan(&self) -> &PowerPlan {
        &self.power_plan
    }

    /// Where the table comes from.
    pub const fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// The table's bytes.
    pub const fn bytes(&self) -> &'t [u8] {
        self.bytes
    }

    /// The checksum at their end.
    pub fn checksum(&self) -> u32 {
        self.bytes.last_chunk().copied().map_or(0, u32::from_le_bytes)
    }
}

/// The form with this code.
fn form<T: Copy>(name: &'static str, all: &[T], code: u8) -> Result<T, ReadError> {
    let largest = all.len().saturating_sub(1) as i32;
    let form = all.get(usize::from(code)).copied();
    form.ok_or(ReadError::field(name, i32::from(code), largest))
}

/// Says the bound that is passed.
fn within(name: &'static str, found: i32, least: i32, most: i32) -> Result<(), ReadError> {
    expect(name, found, found.clamp(least, most))
}

fn expect(name: &'static str, found: i32, expected: i32) -> Result<(), ReadError> {
    if found == expected {
        Ok(())
    } else {
        Err(ReadError::field(name, found, expected))
    }
}

/// Reads little-endian fields from the front of a slice.
struct Reader<'t> {
    rest: &'t [u8],
}

impl<'t> Reader<'t> {
    fn take(&mut self, length: usize) -> Result<&'t [u8], ReadError> {
        let found = self.rest.len();
        let (taken, rest) = self.rest.split_at_checked(length).ok_or(ReadError::Truncated {
            found: found as u32,
            expected: length as u32,
        })?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const LEN: usize>(&mut self) -> Result<[u8; LEN], ReadError> {
        let mut array = [0; LEN];
        array.copy_from_slice(self.take(LEN)?);
        Ok(array)
    }

    fn u16(&mut self) -> Result<u16, ReadError> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    fn u32(&mut self) -> Result<u32, ReadError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn level(&mut self) -> Result<Level, ReadError> {
        Ok(Level::from_le_bytes(self.array()?))
    }
}
