//! Frames survive the wire or are refused; never anything between.

use firmware::link::{LinkError, MAX_FRAME, MeasurementFrame, ModemFrame, Receiver, UnitFrame, encode};
use firmware::measurement::MeasurementError;
use proptest::prelude::*;

fn modem_frame() -> impl Strategy<Value = ModemFrame> {
    let levels = || prop::array::uniform3(any::<i16>());
    let measurement = (
        any::<u32>(),
        levels(),
        levels(),
        any::<Option<u32>>(),
        any::<[u8; 3]>(),
    );
    prop_oneof![
        9 => measurement.prop_map(|(slot, gain, interference, last_acknowledged, [home, period, joiner_probability])| {
            ModemFrame::Measurement(MeasurementFrame {
                slot, gain, interference, last_acknowledged, home, period, joiner_probability,
            })
        }),
        1 => any::<u32>().prop_map(|slot| ModemFrame::Missed { slot }),
    ]
}

fn unit_frame() -> impl Strategy<Value = UnitFrame> {
    (any::<u32>(), any::<Option<(u8, i16)>>(), any::<u8>()).prop_map(|(slot, transmit, state)| UnitFrame {
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
        let received: Vec<Result<UnitFrame, _>> =
            encode(&answer).unwrap().into_iter().filter_map(|byte| receiver.push(byte)).collect();
        prop_assert_eq!(received, vec![Ok(answer)]);
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
                prop_assert_eq!(accepted, vec![next], "byte {} flipped by {:#04x}", position, flip);
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

#[test]
fn the_longest_frames_have_the_documented_length() {
    let longest = ModemFrame::Measurement(MeasurementFrame {
        slot: u32::MAX,
        gain: [i16::MIN; 3],
        interference: [i16::MIN; 3],
        last_acknowledged: Some(u32::MAX),
        home: 255,
        period: 255,
        joiner_probability: 255,
    });
    assert_eq!(encode(&longest).unwrap().len(), 39);
    let longest = UnitFrame {
        slot: u32::MAX,
        transmit: Some((255, i16::MIN)),
        state: 255,
    };
    assert_eq!(encode(&longest).unwrap().len(), 17);
    const { assert!(39 <= MAX_FRAME) };
}

#[test]
fn readings_that_cannot_be_are_refused_by_name() {
    let good = MeasurementFrame {
        slot: 10,
        gain: [0; 3],
        interference: [0; 3],
        last_acknowledged: Some(9),
        home: 2,
        period: 100,
        joiner_probability: 0,
    };
    assert_eq!(MeasurementFrame::from(&good.measurement().unwrap()), good);
    let cases = [
        (
            MeasurementFrame { home: 3, ..good },
            MeasurementError::Home(3),
            "home: found 3, expected 0 to 2",
        ),
        (
            MeasurementFrame { period: 0, ..good },
            MeasurementError::Period(0),
            "period: found 0, expected 1 to 100",
        ),
        (
            MeasurementFrame { period: 101, ..good },
            MeasurementError::Period(101),
            "period: found 101, expected 1 to 100",
        ),
        (
            MeasurementFrame {
                interference: [0, -1, 0],
                ..good
            },
            MeasurementError::InterferenceBelowNoise(1),
            "interference[1]: noise plus interference is below 0 dB over noise",
        ),
        (
            MeasurementFrame {
                last_acknowledged: Some(10),
                ..good
            },
            MeasurementError::AcknowledgedInFuture,
            "last_acknowledged: not before the slot of the measurement",
        ),
    ];
    for (frame, error, text) in cases {
        assert_eq!(frame.measurement(), Err(error));
        assert_eq!(error.to_string(), text);
    }
}
