//! Where vehicles are.

pub mod floating_car_data;
