//! Nothing but a whole, undamaged table of a kind that the firmware serves is accepted, and every refusal says why.

use crate::table_builder::{Contents, Layer, seal};
use firmware::decision::ACTIONS;
use firmware::observation::INPUTS;
use firmware::table::{Table, TableError};
use firmware::units::{Level, MAX_SUB_CHANNELS, SubChannels};

fn small() -> Contents {
    Contents::random(7, &[INPUTS, 5, 3, ACTIONS])
}

#[test]
fn every_field_arrives() {
    let mut contents = small();
    contents.modified = 1;
    let bytes = contents.bytes();
    let table = Table::parse(&bytes).unwrap();
    assert_eq!(table.max_vehicles(), contents.max_vehicles);
    assert_eq!(table.required_sinr(), Level::from_bits(contents.required_sinr));
    assert_eq!(
        table.max_sub_channels().count(),
        usize::from(contents.max_sub_channels)
    );
    assert_eq!(
        table.power_plan().joiner_levels,
        contents.joiner_levels.map(Level::from_bits)
    );
    assert_eq!(table.provenance().seed, contents.seed);
    assert_eq!(table.provenance().revision, contents.revision);
    assert!(table.provenance().modified);
    assert_eq!(table.scales(), &contents.scales);
    assert_eq!(table.bytes(), bytes);
    let widths: Vec<_> = table.network().widths().skip(1).collect();
    assert_eq!(widths, [5, 3, ACTIONS]);
}

/// The ring's form serves every cell up to what the table was trained for; forms that see or choose sub-channels one by one serve three.
#[test]
fn tables_say_which_cells_they_serve() {
    for (observation, output) in
        (0..3).flat_map(|observation| (0..4).map(move |output| (observation, output)))
    {
        for most in [1, 3, 8, 16] {
            let mut contents = Contents::in_form(3, observation, output);
            contents.max_sub_channels = most;
            let bytes = contents.bytes();
            let table = Table::parse(&bytes).unwrap();
            for count in 1..=MAX_SUB_CHANNELS {
                let expected = match (observation, output) {
                    (0, 0) => count <= usize::from(most),
                    _ => count == 3,
                };
                assert_eq!(
                    table.serves(SubChannels::new(count).unwrap()),
                    expected,
                    "{most}, {count}"
                );
            }
        }
    }
}

#[test]
fn every_truncation_is_refused() {
    let bytes = small().bytes();
    for length in 0..bytes.len() {
        assert!(
            Table::parse(&bytes[..length]).is_err(),
            "{length} of {} bytes",
            bytes.len()
        );
    }
    let mut longer = bytes;
    longer.push(0);
    assert!(Table::parse(&longer).is_err(), "one byte too many");
}

#[test]
fn every_flipped_bit_is_refused() {
    let mut bytes = small().bytes();
    assert!(Table::parse(&bytes).is_ok());
    for bit in 0..bytes.len() * 8 {
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert!(
            Table::parse(&bytes).is_err(),
            "bit {} of byte {}",
            bit % 8,
            bit / 8
        );
        bytes[bit / 8] ^= 1 << (bit % 8);
    }
}

/// The error's text for a table with one thing wrong and a checksum that fits.
fn refusal(change: impl FnOnce(&mut Contents)) -> String {
    let mut contents = small();
    change(&mut contents);
    Table::parse(&contents.bytes()).unwrap_err().to_string()
}

fn widen(contents: &mut Contents, layer: usize, inputs: usize) {
    contents.widths[layer] = inputs as u16;
    for row in &mut contents.layers[layer].weights {
        row.resize(inputs, 0);
    }
}

#[test]
fn every_refusal_names_its_field() {
    let cases: [(String, &str); 36] = [
        (
            refusal(|c| c.magic = *b"GIRF"),
            "magic: found [47, 49, 52, 46], expected [46, 4c, 41, 54] (FLAT)",
        ),
        (refusal(|c| c.version = 2), "version: found 2, expected 3"),
        (
            refusal(|c| c.max_sub_channels = 0),
            "sub_channels: found 0, expected 16",
        ),
        (
            refusal(|c| c.max_sub_channels = 17),
            "sub_channels: found 17, expected 16",
        ),
        (refusal(|c| c.max_vehicles = 0), "vehicles: found 0, expected 1"),
        (
            refusal(|c| c.max_vehicles = 4001),
            "vehicles: found 4001, expected 4000",
        ),
        (
            refusal(|c| c.required_sinr = -20 * 256 - 1),
            "required SINR: found -5121, expected -5120",
        ),
        (
            refusal(|c| c.required_sinr = 60 * 256 + 1),
            "required SINR: found 15361, expected 15360",
        ),
        (
            refusal(|c| c.joiner_levels[0] = c.required_sinr - 1),
            "joiner level: found 2559, expected 2560",
        ),
        (
            refusal(|c| c.joiner_levels[3] = c.joiner_levels[2] - 1),
            "joiner level: found 8703, expected 8704",
        ),
        (refusal(|c| c.scales[3] = 0), "scale: found 0, expected 1"),
        (refusal(|c| c.scales[0] = 0), "scale: found 0, expected 1"),
        (refusal(|c| c.scales[4] = 9), "scale: found 9, expected 0"),
        (refusal(|c| c.layer_count = 0), "layers: found 0, expected 4"),
        (refusal(|c| c.layer_count = 5), "layers: found 5, expected 4"),
        (refusal(|c| c.layer_count = 2), "width: found 7, expected 0"),
        (refusal(|c| c.layer_count = 4), "width: found 0, expected 1024"),
        (
            refusal(|c| c.widths[1] = 1025),
            "width: found 1025, expected 1024",
        ),
        (
            refusal(|c| c.forms[0] = 3),
            "observation form: found 3, expected 2",
        ),
        (refusal(|c| c.forms[1] = 4), "output form: found 4, expected 3"),
        (refusal(|c| c.forms[0] = 2), "inputs: found 22, expected 7"),
        (
            refusal(|c| {
                *c = Contents::in_form(7, 2, 3);
                c.scales[2] += 1;
            }),
            "output scale: found 65537, expected 65536",
        ),
        (refusal(|c| c.reserved.0 = 256), "reserved: found 256, expected 0"),
        (refusal(|c| c.reserved.1 = 1), "reserved: found 1, expected 0"),
        (refusal(|c| c.modified = 2), "modified: found 2, expected 1"),
        (
            refusal(|c| c.layers[1].biases[2] = (1 << 30) + 1),
            "bias: found 1073741825, expected 1073741824",
        ),
        (refusal(|c| c.padding = 1), "padding: found 1, expected 0"),
        (refusal(|c| c.row_padding.0 = 6), "padding: found 6, expected 0"),
        (refusal(|c| c.row_padding.1 = 6), "padding: found 6, expected 0"),
        (
            refusal(|c| c.start_error = 1),
            "start of sums: found -371808, expected -371809",
        ),
        (
            // The largest even row of 5 hidden inputs: 5 x 255 x 127 and the bias; one more does not fit.
            refusal(|c| {
                c.layers[1].weights[2] = vec![127; 5];
                c.layers[1].biases[2] = (1 << 23) - 5 * 255 * 127;
            }),
            "even row sum: found 8388608, expected 8388608",
        ),
        (
            // The least: the first layer's int8 inputs, -128 x 127 of them.
            refusal(|c| {
                c.layers[0].weights[4] = vec![127; 22];
                c.layers[0].biases[4] = -(1 << 23) + 22 * 128 * 127 - 1;
            }),
            "even row sum: found -8388609, expected 8388608",
        ),
        (
            // 256 x -128 - 1 wraps.
            refusal(|c| {
                c.layers[1].weights[0][0] = -128;
                c.layers[1].weights[1] = vec![-1; 5];
            }),
            "weight pair: found 32767, expected 32639",
        ),
        (refusal(|c| widen(c, 0, 23)), "inputs: found 23, expected 22"),
        (
            refusal(|c| {
                let last: &mut Layer = c.layers.last_mut().unwrap();
                last.biases.push(0);
                last.multipliers.push(0);
                last.weights.push(vec![0; 3]);
                c.widths[3] = 8;
            }),
            "outputs: found 8, expected 7",
        ),
        (
            refusal(|c| drop(c.layers.pop())),
            "truncated: found 48 bytes, expected at least 128",
        ),
    ];
    for (found, expected) in cases {
        assert_eq!(found, expected);
    }

    let whole = small().bytes();
    let mut body = whole[..whole.len() - 4].to_vec();
    body.extend([0; 8]);
    let left_over = seal(body);
    assert_eq!(
        Table::parse(&left_over).unwrap_err().to_string(),
        "left over bytes: found 8, expected 0"
    );
    assert_eq!(
        Table::parse(&whole[..90]).unwrap_err().to_string(),
        "truncated: found 90 bytes, expected at least 92"
    );
    assert_eq!(
        Table::parse(&whole[..100]).unwrap_err(),
        TableError::Length {
            header: whole.len() as u32,
            found: 100
        }
    );
    let mut damaged = whole;
    damaged[20] ^= 1;
    let error = Table::parse(&damaged).unwrap_err();
    assert!(matches!(error, TableError::Checksum { .. }));
    assert!(
        error.to_string().ends_with("as stored: the table is damaged"),
        "{error}"
    );
}

#[test]
fn a_built_in_table_describes_itself() {
    // Whichever table is built in, it either parses or says what is wrong with it.
    match Table::parse(firmware::tables::DISTILLED) {
        Ok(table) => assert!(table.bytes().len() <= 8 << 10),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

#[test]
fn a_table_that_does_not_begin_at_a_word_is_refused() {
    let table = firmware::tables::DISTILLED;
    // Three bytes to spare: at one of the four places it begins at a word.
    let mut memory = vec![0; table.len() + 3];
    let start = memory.as_ptr().addr();
    for shift in 0..4 {
        memory[shift..shift + table.len()].copy_from_slice(table);
        let outcome = Table::parse(&memory[shift..shift + table.len()]).map(drop);
        match (start + shift) % 4 {
            0 => assert_eq!(outcome, Ok(())),
            past => assert_eq!(
                outcome.unwrap_err().to_string(),
                format!(
                    "alignment: found bytes that begin {past} behind a word's boundary, expected some that begin at a word, as in table::Aligned"
                )
            ),
        }
    }
}
