//! Frames survive the wire or are refused; never anything between.

use firmware::link::{
    CHUNK_LEN, Frame, Levels, LinkError, MAX_FRAME, MeasurementFrame, ModemFrame, Receiver, UnitFrame,
    UnitMessage, UpdateAnswer, UpdateFrame, encode,
};
use firmware::measurement::MeasurementError;
use firmware::ring::MAX_PLACES;
use firmware::units::MAX_SUB_CHANNELS;
use proptest::prelude::*;

/// Gains and as many interferences.
fn levels() -> impl Strategy<Value = (Levels, Levels)> {
    prop::collection::vec(any::<(i16, i16)>(), 0..=MAX_SUB_CHANNELS)
        .prop_map(|pairs| pairs.into_iter().unzip())
}

fn modem_frame() -> impl Strategy<Value = ModemFrame> {
    let levels = levels();
    let vehicle = (
        any::<u32>(),
        any::<Option<u32>>(),
        any::<Option<(u16, bool)>>(),
        any::<bool>(),
        any::<u8>(),
    );
    let broadcast = (
        any::<u16>(),
        any::<u16>(),
        any::<u32>(),
        any::<u8>(),
        any::<bool>(),
        any::<i16>(),
    );
    let measurement = (levels, vehicle, broadcast).prop_map(|((gain, interference), vehicle, broadcast)| {
        let (slot, last_acknowledged, place, awaits_acknowledgement, weight) = vehicle;
        let (places, open, threshold, salt, gains_hold, max_power) = broadcast;
        ModemFrame::Measurement(MeasurementFrame {
            slot,
            gain,
            interference,
            last_acknowledged,
            place,
            awaits_acknowledgement,
            places,
            open,
            threshold,
            salt,
            gains_hold,
            weight,
            max_power,
        })
    });
    prop_oneof![
        9 => measurement,
        1 => any::<u32>().prop_map(|slot| ModemFrame::Missed { slot }),
        1 => any::<u32>().prop_map(|number| ModemFrame::Identity { number }),
        1 => Just(ModemFrame::Hello),
    ]
}

fn unit_frame() -> impl Strategy<Value = UnitFrame> {
    // 255 stands for none.
    let transmit = proptest::option::of((0..255_u8, any::<i16>()));
    (any::<u32>(), transmit, any::<u8>()).prop_map(|(slot, transmit, state)| UnitFrame {
        slot,
        transmit,
        state,
    })
}

fn receive(bytes: &[u8]) -> Vec<Result<ModemFrame, LinkError>> {
    let mut receiver = Receiver::default();
    bytes.iter().filter_map(|&byte| receiver.push(byte)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn frames_survive_the_wire(frames in prop::collection::vec(modem_frame(), 1..5), answer in unit_frame()) {
        let wire: Vec<u8> = frames.iter().flat_map(|frame| encode(frame).unwrap()).collect();
        prop_assert_eq!(receive(&wire), frames.into_iter().map(Ok).collect::<Vec<_>>());

        let mut receiver = Receiver::default();
        let received: Vec<Result<UnitMessage, _>> =
            encode(&UnitMessage::Decision(answer)).unwrap().into_iter().filter_map(|byte| receiver.push(byte)).collect();
        prop_assert_eq!(received, vec![Ok(UnitMessage::Decision(answer))]);
    }

    #[test]
    fn a_corrupted_byte_never_makes_another_frame(frame in modem_frame(), next in modem_frame()) {
        let wire = encode(&frame).unwrap();
        let following = encode(&next).unwrap();
        for position in 0..wire.len() {
            for flip in 1..=255_u8 {
                let mut bytes = wire.to_vec();
                bytes[position] ^= flip;
                // An empty frame between: a corrupted delimiter costs the frame before it alone.
                bytes.push(0);
                bytes.extend(&following);
                let accepted: Vec<_> = receive(&bytes).into_iter().filter_map(Result::ok).collect();
                prop_assert_eq!(&accepted, &vec![next.clone()], "byte {} flipped by {:#04x}", position, flip);
            }
        }
    }

    #[test]
    fn garbage_ends_at_the_next_delimiter(
        garbage in prop::collection::vec(any::<u8>(), 0..400),
        frame in modem_frame(),
    ) {
        let mut bytes = garbage;
        bytes.push(0);
        bytes.extend(encode(&frame).unwrap());
        let received = receive(&bytes);
        prop_assert_eq!(received.last(), Some(&Ok(frame)));
        prop_assert!(received.iter().rev().skip(1).all(Result::is_err), "garbage was taken for a frame");
    }
}

#[test]
fn a_flood_is_one_dropped_frame() {
    let frame = ModemFrame::Missed { slot: 77 };
    let mut bytes = vec![0xaa; 100_000];
    bytes.push(0);
    bytes.extend(encode(&frame).unwrap());
    assert_eq!(receive(&bytes), [Err(LinkError::TooLong), Ok(frame)]);
    assert_eq!(receive(&[0; 100]), [], "empty frames are no frames");
}

/// The longest measurement of so many sub-channels: every number takes as many bytes as its kind ever does.
fn longest(sub_channels: usize) -> MeasurementFrame {
    let levels = || Levels::from_slice(&vec![i16::MIN; sub_channels]).unwrap();
    MeasurementFrame {
        slot: u32::MAX,
        gain: levels(),
        interference: levels(),
        last_acknowledged: Some(u32::MAX),
        place: Some((u16::MAX, true)),
        awaits_acknowledgement: true,
        places: u16::MAX,
        open: u16::MAX,
        threshold: u32::MAX,
        salt: 255,
        gains_hold: true,
        weight: 255,
        max_power: i16::MIN,
    }
}

#[test]
fn the_longest_frames_have_the_documented_length() {
    let measurement = |sub_channels| {
        encode(&ModemFrame::Measurement(longest(sub_channels)))
            .unwrap()
            .len()
    };
    assert_eq!(measurement(MAX_SUB_CHANNELS), 95);
    assert_eq!(measurement(8), 63);
    assert_eq!(measurement(3), 43);
    let chunk = UpdateFrame::Chunk {
        offset: u32::MAX,
        bytes: [255; CHUNK_LEN],
    };
    assert_eq!(encode(&ModemFrame::Update(chunk)).unwrap().len(), 45);
    let answer = UnitFrame {
        slot: u32::MAX,
        transmit: Some((254, i16::MIN)),
        state: 255,
    };
    assert_eq!(encode(&UnitMessage::Decision(answer)).unwrap().len(), 15);
    let update = UpdateAnswer::Continue { offset: u32::MAX };
    assert!(encode(&UnitMessage::Update(update)).unwrap().len() <= 18);
    const { assert!(95 <= MAX_FRAME) };
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_frame_is_longer_than_the_longest(frame in modem_frame()) {
        prop_assert!(encode(&frame).unwrap().len() <= 95);
    }
}

fn of(levels: &[i16]) -> Levels {
    Levels::from_slice(levels).unwrap()
}

#[test]
fn readings_that_cannot_be_are_refused_by_name() {
    let good = MeasurementFrame {
        slot: 10,
        gain: of(&[0; 3]),
        interference: of(&[0; 3]),
        last_acknowledged: Some(9),
        place: Some((MAX_PLACES, false)),
        awaits_acknowledgement: true,
        places: MAX_PLACES,
        open: u16::MAX,
        threshold: u32::MAX,
        salt: 9,
        gains_hold: true,
        weight: 33,
        max_power: -7,
    };
    assert_eq!(MeasurementFrame::from(&good.measurement().unwrap()), good);
    let smallest = MeasurementFrame {
        gain: of(&[i16::MIN]),
        interference: of(&[0]),
        last_acknowledged: None,
        place: None,
        places: 1,
        ..good.clone()
    };
    assert_eq!(MeasurementFrame::from(&smallest.measurement().unwrap()), smallest);
    type Change = fn(&mut MeasurementFrame);
    let rings: [(Change, &str); 4] = [
        (
            |frame| (frame.gain, frame.interference) = Default::default(),
            "4000 places on 0 sub-channels",
        ),
        (|frame| frame.places = 0, "0 places on 3 sub-channels"),
        (|frame| frame.places = 2, "2 places on 3 sub-channels"),
        (
            |frame| frame.places = MAX_PLACES + 1,
            "4001 places on 3 sub-channels",
        ),
    ];
    for (change, found) in rings {
        let mut frame = good.clone();
        change(&mut frame);
        let error = frame.measurement().unwrap_err();
        assert!(matches!(error, MeasurementError::Ring { .. }), "{error:?}");
        let expected = "expected 1 to 16 sub-channels, and from as many places to 4000";
        assert_eq!(error.to_string(), format!("ring: found {found}; {expected}"));
    }
    let others: [(Change, MeasurementError, &str); 4] = [
        (
            |frame| frame.interference = of(&[0; 4]),
            MeasurementError::SubChannels {
                found: 4,
                expected: 3,
            },
            "gain, interference: found 4 levels, expected 3, one for each sub-channel",
        ),
        (
            |frame| frame.interference.clear(),
            MeasurementError::SubChannels {
                found: 0,
                expected: 3,
            },
            "gain, interference: found 0 levels, expected 3, one for each sub-channel",
        ),
        (
            |frame| frame.interference = of(&[0, -1, 0]),
            MeasurementError::InterferenceBelowNoise(1),
            "interference[1]: noise plus interference is below 0 dB over noise",
        ),
        (
            |frame| frame.last_acknowledged = Some(10),
            MeasurementError::AcknowledgedInFuture,
            "last_acknowledged: not before the slot of the measurement",
        ),
    ];
    for (change, error, text) in others {
        let mut frame = good.clone();
        change(&mut frame);
        assert_eq!(frame.measurement(), Err(error));
        assert_eq!(error.to_string(), text);
    }
}

/// A frame with any fields and the right checksum.
fn framed(fields: &[u8]) -> Vec<u8> {
    struct Raw(Vec<u8>);
    impl Frame for Raw {
        fn write(&self, room: &mut [u8]) -> Option<usize> {
            room.get_mut(..self.0.len())?.copy_from_slice(&self.0);
            Some(self.0.len())
        }
        fn read(fields: &[u8]) -> Option<Self> {
            Some(Self(fields.to_vec()))
        }
    }
    encode(&Raw(fields.to_vec())).unwrap().to_vec()
}

#[test]
fn every_field_of_a_measurement_has_its_place() {
    let frame = MeasurementFrame {
        slot: 0x0403_0201,
        gain: of(&[0x1211, -2]),
        interference: of(&[0x1413, 5]),
        last_acknowledged: Some(0x0807_0605),
        place: Some((0x0e0d, true)),
        awaits_acknowledgement: false,
        places: 0x100f,
        open: 0x1615,
        threshold: 0x0c0b_0a09,
        salt: 0x19,
        gains_hold: true,
        weight: 0x1a,
        max_power: 0x1817,
    };
    let mut fields = [0; 33];
    assert_eq!(
        ModemFrame::Measurement(frame.clone()).write(&mut fields),
        Some(33)
    );
    let expected = [
        6, 2, 0b10111, 0x1a, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 0x0f, 0x10, 0x0d, 0x0e, 0x15, 0x16, 0x17,
        0x18, 0x19, 0x11, 0x12, 0xfe, 0xff, 0x13, 0x14, 5, 0,
    ];
    assert_eq!(fields, expected);
    assert_eq!(
        receive(&framed(&fields)),
        [Ok(ModemFrame::Measurement(frame.clone()))]
    );
    // What is not this layout is no frame, whatever its checksum.
    let refused = |fields: &[u8]| {
        assert_eq!(
            receive(&framed(fields)),
            [Err(LinkError::Contents)],
            "{fields:02x?}"
        )
    };
    for length in 0..fields.len() {
        refused(&fields[..length]);
    }
    refused(&[&fields[..], &[0]].concat());
    for (position, value) in [(0, 7), (1, 1), (1, 3), (1, 255), (2, 0b110111), (2, 0b1001_0111)] {
        let mut other = fields;
        other[position] = value;
        refused(&other);
    }
    let mut too_many = fields.to_vec();
    too_many.resize(25 + 4 * 17, 0);
    too_many[1] = 17;
    assert_eq!(ModemFrame::read(&too_many), None);
    let one_sided = MeasurementFrame {
        interference: of(&[3]),
        ..frame
    };
    assert_eq!(
        encode(&ModemFrame::Measurement(one_sided)),
        Err(LinkError::Encoding)
    );
}

#[test]
fn a_run_of_bytes_is_taken_frame_by_frame() {
    let frames = [
        ModemFrame::Missed { slot: 77 },
        ModemFrame::Hello,
        ModemFrame::Measurement(longest(3)),
    ];
    let wire: Vec<u8> = frames.iter().flat_map(|frame| encode(frame).unwrap()).collect();
    // However the line cuts them.
    for piece in 1..=wire.len() {
        let mut receiver = Receiver::new();
        let mut received = Vec::new();
        for mut bytes in wire.chunks(piece) {
            while !bytes.is_empty() {
                if let Some(fields) = receiver.take(&mut bytes) {
                    received.push(ModemFrame::read(fields.unwrap()).unwrap());
                }
            }
        }
        assert_eq!(received, frames, "pieces of {piece}");
    }
}
