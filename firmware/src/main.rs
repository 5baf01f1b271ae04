//! Placeholder image.
fn main() {}
