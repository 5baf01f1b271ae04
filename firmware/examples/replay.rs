//! A recorded slot, byte by byte through what runs in a unit: one measurement frame in, one decision frame out.
//!
//! ```console
//! $ cargo run -p firmware --example replay
//! ```

use firmware::decision::Decision;
use firmware::link::{Receiver, UnitMessage, encode};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;

/// What a modem sent in slot 1007, as it was on the wire: a vehicle whose place in a ring of 22 is 7, which three sub-channels carry in
/// this slot on sub-channel 1; last acknowledged in slot 1000, with 31, 26.25 and 40.5 dB over noise at full power.
const FRAME: [u8; 43] = [
    7, 6, 3, 23, 32, 239, 3, 1, 3, 232, 3, 1, 4, 128, 56, 1, 2, 22, 2, 7, 2, 4, 1, 3, 30, 9, 7, 31, 64, 26,
    128, 40, 130, 1, 1, 2, 200, 5, 156, 220, 44, 88, 0,
];

/// What the unit answered.
const ANSWER: [u8; 15] = [4, 3, 239, 3, 1, 2, 1, 2, 30, 5, 129, 93, 97, 216, 0];

fn main() {
    // A unit with the table that is built in. Its lots follow from the number and the slot, so that the slot replays.
    let mut session = Session::new(Unit::new(DISTILLED, Identity(7)));
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
