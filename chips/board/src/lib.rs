//! What the boards of this folder share. On a chip with a HAL for Embassy the HAL has both: a time driver and buffered UARTs.
#![no_std]

pub mod clock;
pub mod line;
