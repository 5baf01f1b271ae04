//! A recorded slot, byte by byte through what runs in a unit: one measurement frame in, one decision frame out.
//!
//! ```console
//! $ cargo run -p firmware --example replay
//! ```

use firmware::decision::Decision;
use firmware::link::{Receiver, UnitMessage, encode};
use firmware::session::{Request, Session};
use firmware::tables::DISTILLED;
use firmware::unit::{Unit, back_off};

/// What a modem sent in slot 1007, as it was on the wire: a vehicle at home on sub-channel 1, in a group of seven, last
/// acknowledged in slot 1000, with 31, 26.25 and 40.5 dB over noise at full power.
const FRAME: [u8; 26] = [
    1, 10, 239, 7, 128, 124, 128, 105, 128, 162, 1, 3, 128, 50, 11, 1, 232, 7, 1, 7, 54, 212, 228, 191, 105,
    0,
];

/// What the unit answered.
const ANSWER: [u8; 14] = [1, 7, 239, 7, 1, 1, 128, 120, 5, 132, 159, 192, 14, 0];

fn main() {
    // A unit with the table that is built in. The number seeds its back-off after a lost turn.
    let mut session = Session::new(Unit::new(DISTILLED, back_off([1, 2, 3])));
    let requests: Vec<Request> = FRAME.iter().filter_map(|&byte| session.byte(byte)).collect();
    let [Request::Answer(answer)] = requests.as_slice() else {
        panic!("expected one answer, found {requests:?}");
    };
    let wire = encode(answer).expect("an answer that fits a frame");
    println!("in:  {} bytes {FRAME:02x?}", FRAME.len());
    println!("out: {} bytes {wire:02x?}", wire.len());
    let UnitMessage::Decision(frame) = answer else {
        panic!("expected a decision, found {answer:?}");
    };
    match frame.decision() {
        Some(Decision::Transmit { sub_channel, power }) => println!(
            "slot {}: send on sub-channel {} with {} dBm",
            frame.slot,
            sub_channel.index(),
            power.value()
        ),
        _ => println!("slot {}: stay silent", frame.slot),
    }
    assert_eq!(wire.as_slice(), ANSWER, "the recorded answer");
    // The modem reads it as the unit wrote it.
    let mut modem = Receiver::default();
    let heard = wire
        .iter()
        .filter_map(|&byte| modem.push::<UnitMessage>(byte))
        .last();
    assert_eq!(heard.and_then(Result::ok), Some(*answer));
}
