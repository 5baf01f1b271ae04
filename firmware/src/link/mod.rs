//! Frames between modem and unit, on a byte stream: postcard for the fields, CRC-32 behind them, COBS around both, and a
//! zero byte at the end.

mod frame;
mod receiver;

pub use frame::{MAX_FRAME, MeasurementFrame, ModemFrame, UnitFrame, encode};
pub use receiver::{LinkError, Receiver};
