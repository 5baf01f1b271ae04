//! The tables built into the image. `cargo run --release -p trainer -- export` writes them; never edit them by hand.

mod distilled;

pub use distilled::DISTILLED;
