//! Writes weight tables from scratch, by the layout in `firmware::table`'s documentation and not with its code.

use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

/// One dense layer.
#[derive(Clone, Debug)]
pub struct Layer {
    /// One for each output.
    pub biases: Vec<i32>,
    /// One for each output.
    pub multipliers: Vec<i32>,
    /// `[output][input]`.
    pub weights: Vec<Vec<i8>>,
}

/// Every field of a table.
#[derive(Clone, Debug)]
pub struct Contents {
    /// The first four bytes.
    pub magic: [u8; 4],
    /// The format's version.
    pub version: u16,
    /// The number of layers as the header states it.
    pub layer_count: u8,
    /// Most sub-channels.
    pub max_sub_channels: u8,
    /// Most vehicles.
    pub max_vehicles: u16,
    /// Required SINR in 1/256 dB.
    pub required_sinr: i16,
    /// Joiner levels in 1/256 dB.
    pub joiner_levels: [i16; 4],
    /// Codes of what the network sees and of what its outputs mean.
    pub forms: [u8; 2],
    /// The reserved fields: two bytes and one.
    pub reserved: (u16, u8),
    /// Widths as the header states them.
    pub widths: [u16; 5],
    /// Uncommitted changes.
    pub modified: u8,
    /// Training seed.
    pub seed: u64,
    /// Source revision.
    pub revision: [u8; 20],
    /// Scales in 2^-24.
    pub scales: [u32; 5],
    /// The layers.
    pub layers: Vec<Layer>,
    /// The weights of padding rows and columns, in their odd rows.
    pub padding: i8,
    /// The biases and multipliers of padding rows.
    pub row_padding: (i32, i32),
    /// Added to the sums that every quad starts from.
    pub start_error: i32,
}

impl Contents {
    /// A random network of these widths: at least the inputs and one layer, at most four layers.
    pub fn random(seed: u64, widths: &[usize]) -> Self {
        let mut rng = Pcg64Mcg::new((u128::from(seed) << 1) ^ 0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c834);
        let layers = widths
            .windows(2)
            .map(|pair| Layer::random(&mut rng, pair[0], pair[1]))
            .collect();
        let mut header_widths = [0; 5];
        for (field, &width) in header_widths.iter_mut().zip(widths) {
            *field = u16::try_from(width).unwrap();
        }
        let mut revision = [0; 20];
        rng.fill_bytes(&mut revision);
        Self {
            magic: *b"FLAT",
            version: 3,
            layer_count: u8::try_from(widths.len() - 1).unwrap(),
            max_sub_channels: 8,
            max_vehicles: 60,
            required_sinr: 10 << 8,
            joiner_levels: [12 << 8, 23 << 8, 34 << 8, 45 << 8],
            forms: [0; 2],
            reserved: (0, 0),
            widths: header_widths,
            modified: 0,
            seed,
            revision,
            scales: std::array::from_fn(|index| match index {
                0 => 1 << 18,
                _ if index < widths.len() => 1 << 16,
                _ => 0,
            }),
            layers,
            padding: 0,
            row_padding: (0, 0),
            start_error: 0,
        }
    }

    /// A random network of these forms' codes, with one hidden layer.
    pub fn in_form(seed: u64, observation: u8, output: u8) -> Self {
        let inputs = [22, 61, 7][usize::from(observation)];
        let outputs = [7, 7, 7, 2][usize::from(output)];
        let mut contents = Self::random(seed, &[inputs, 16, outputs]);
        contents.forms = [observation, output];
        if output == 3 {
            // A real value of 1 is 256 steps: results spread over about 400.
            contents.scales[2] = 1 << 16;
            for multiplier in &mut contents.layers[1].multipliers {
                *multiplier = multiplier.saturating_mul(4);
            }
        }
        contents
    }

    /// The table's bytes, with a checksum that fits them.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(self.magic);
        bytes.extend(self.version.to_le_bytes());
        bytes.extend([self.layer_count, self.max_sub_channels]);
        bytes.extend([0; 4]); // the length, when it is known
        bytes.extend(self.max_vehicles.to_le_bytes());
        bytes.extend(self.required_sinr.to_le_bytes());
        bytes.extend(self.reserved.0.to_le_bytes());
        bytes.extend(self.joiner_levels.iter().flat_map(|level| level.to_le_bytes()));
        bytes.extend(self.forms);
        bytes.extend(self.widths.iter().flat_map(|width| width.to_le_bytes()));
        bytes.extend([self.modified, self.reserved.1]);
        bytes.extend(self.seed.to_le_bytes());
        bytes.extend(self.revision);
        bytes.extend(self.scales.iter().flat_map(|scale| scale.to_le_bytes()));
        assert_eq!(bytes.len(), 88);
        bytes.extend(self.network_bytes());
        seal(bytes)
    }

    /// The layers' bytes alone.
    pub fn network_bytes(&self) -> Vec<u8> {
        let last = self.layers.len() - 1;
        let layers = self.layers.iter().enumerate();
        layers
            .flat_map(|(index, layer)| self.layer_bytes(layer, index == last))
            .collect()
    }

    fn layer_bytes(&self, layer: &Layer, last: bool) -> Vec<u8> {
        let outputs = layer.biases.len();
        let rows = outputs.next_multiple_of(if last { 4 } else { 8 });
        let columns = layer.weights[0].len().next_multiple_of(8);
        let bias = |row: usize| layer.biases.get(row).copied().unwrap_or(self.row_padding.0);
        let weight = |row: usize, column: usize| {
            let padding = if row % 2 == 1 { self.padding } else { 0 };
            let weight = layer.weights.get(row).and_then(|row| row.get(column));
            i32::from(weight.copied().unwrap_or(padding))
        };
        let mut bytes: Vec<u8> = (0..rows).flat_map(|row| bias(row).to_le_bytes()).collect();
        for quad in (0..rows).step_by(4) {
            for even in [quad, quad + 2] {
                let odd = even + 1;
                let surplus: i32 = (0..columns)
                    .filter(|column| column % 4 < 2)
                    .map(|column| weight(odd, column) * weight(odd, column + 2))
                    .sum();
                let both = (i64::from(bias(even)) * 256 + i64::from(bias(odd))) as i32;
                bytes.extend((both + self.start_error).to_le_bytes());
                bytes.extend((bias(odd) - surplus).to_le_bytes());
            }
            for block in (0..columns).step_by(4) {
                for even in [quad, quad + 2] {
                    for column in block..block + 4 {
                        let halfword = 256 * weight(even, column) + weight(even + 1, column);
                        // Tests of refusals put in what does not fit.
                        bytes.extend((halfword as i16).to_le_bytes());
                    }
                }
            }
            for row in quad..quad + 4 {
                let multiplier = layer.multipliers.get(row).copied().unwrap_or(self.row_padding.1);
                bytes.extend(multiplier.to_le_bytes());
            }
        }
        bytes
    }
}

/// Writes the length and appends the checksum.
pub fn seal(mut body: Vec<u8>) -> Vec<u8> {
    let length = u32::try_from(body.len() + 4).unwrap();
    body[8..12].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32(&body);
    body.extend(checksum.to_le_bytes());
    body
}

impl Layer {
    /// A random layer whose results spread over about 100.
    pub fn random(rng: &mut Pcg64Mcg, inputs: usize, outputs: usize) -> Self {
        let weights: Vec<Vec<i8>> = (0..outputs)
            .map(|_| {
                let row: Vec<i32> = (0..inputs).map(|_| weight(rng)).collect();
                // Activations are mostly positive: a row with a mean would win or lose on every input.
                let mean = row.iter().sum::<i32>() / row.len() as i32;
                row.iter()
                    .map(|weight| (weight - mean).clamp(-127, 127) as i8)
                    .collect()
            })
            .collect();
        // A sum of `inputs` products of about 40 and 64 spreads over sqrt(inputs) x 2,600; this scales it to about 100, so that
        // hidden units work in their range.
        let spread = libm::sqrt(inputs as f64) * 2_600.0;
        let multiplier = libm::round(4_294_967_296.0 * 100.0 / spread) as i64;
        Self {
            biases: (0..outputs).map(|_| symmetric(rng, 1 << 13)).collect(),
            multipliers: (0..outputs)
                .map(|_| {
                    (multiplier + i64::from(symmetric(rng, 1 << 20))).clamp(1, i64::from(i32::MAX)) as i32
                })
                .collect(),
            weights,
        }
    }
}

/// About Gaussian with a standard deviation of 42, of magnitude 146 at most.
fn weight(rng: &mut Pcg64Mcg) -> i32 {
    let sum: i32 = rng
        .next_u32()
        .to_le_bytes()
        .iter()
        .map(|&byte| i32::from(byte))
        .sum();
    (sum - 510) * 2 / 7
}

fn symmetric(rng: &mut Pcg64Mcg, magnitude: i32) -> i32 {
    (rng.next_u32() % (2 * magnitude.unsigned_abs() + 1)).cast_signed() - magnitude
}

/// CRC-32/ISO-HDLC, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
        })
    })
}
