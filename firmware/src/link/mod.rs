//! Frames between modem and unit, on a byte stream: fields, a CRC-32 behind them, COBS around both, and a zero byte at the end. A slot's
//! readings and its decision have layouts of their own ([`MeasurementFrame`], [`UnitFrame`]); all other fields are postcard's.

mod frame;
mod measurement;
mod receiver;
mod status;

pub use frame::{
    CHUNK_LEN, Frame, Levels, MAX_FRAME, ModemFrame, PROTOCOL, Refusal, UnitFrame, UnitMessage, UpdateAnswer,
    UpdateFrame, encode, encode_into,
};
pub use measurement::{MeasurementFrame, measurement};
pub use receiver::{LinkError, Receiver};
pub use status::{ClockSource, Counters, ImageStatus, ResetCause, StatusFrame, TableStatus, Trial};
