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
const FRAME: [u8; 40] = [
    1, 14, 239, 7, 3, 128, 124, 128, 105, 128, 162, 1, 3, 132, 2, 9, 144, 3, 1, 232, 7, 1, 7, 1, 15, 22, 4,
    128, 241, 4, 9, 1, 32, 128, 120, 200, 171, 138, 25, 0,
];

/// What the unit answered.
const ANSWER: [u8; 14] = [1, 7, 239, 7, 1, 1, 128, 120, 5, 132, 159, 192, 14, 0];

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
