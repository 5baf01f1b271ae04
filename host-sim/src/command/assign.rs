//! `host-sim assign`.
