//! SUMO floating-car data.
