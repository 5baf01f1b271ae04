//! Frames between modem and unit, on a byte stream: postcard for the fields, CRC-32 behind them, COBS around both, and a
//! zero byte at the end.

mod frame;
mod receiver;
mod status;

pub use frame::{
    CHUNK_LEN, Levels, MAX_FRAME, MeasurementFrame, ModemFrame, Refusal, UnitFrame, UnitMessage,
    UpdateAnswer, UpdateFrame, encode,
};
pub use receiver::{LinkError, Receiver};
pub use status::{ClockSource, Counters, ImageStatus, ResetCause, StatusFrame, TableStatus, Trial};
