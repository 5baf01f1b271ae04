//! The command line's sub-commands.

pub mod adapt;
pub mod bench;
pub mod cells;
pub mod compare;
pub mod distil;
pub mod eval;
pub mod explain;
pub mod export;
pub mod key;
pub mod sign;
pub mod study;
pub mod train;
