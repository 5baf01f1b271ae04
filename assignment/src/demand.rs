//! Demand: how many vehicles go from each zone to each other one.

use crate::link::check_not_negative;
use kit::error::{Error, Result};
#[cfg(feature = "formats")]
use std::collections::HashSet;

/// One entry of an origin-destination table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trip {
    /// Zone it starts from, from 1.
    pub origin: u32,
    /// Zone it goes to, from 1.
    pub destination: u32,
    /// Vehicles per unit of time.
    pub volume: f64,
}

/// The trips of one origin, zones as indices from 0.
#[derive(Debug, Clone)]
pub(crate) struct OriginDemand {
    pub(crate) origin: u32,
    /// By ascending destination, each once, volumes positive.
    pub(crate) destinations: Vec<(u32, f64)>,
}

/// An origin-destination table without intrazonal trips, which use no link.
#[derive(Debug, Clone)]
pub struct Demand {
    zones: u32,
    origins: Vec<OriginDemand>,
    total: f64,
    intrazonal: f64,
}

impl Demand {
    /// Builds the table. Trips between the same two zones add up; trips within a zone are counted and dropped.
    ///
    /// # Errors
    /// [`Error::Input`] for a zone outside 1 to `zones`, or a volume that is negative or not finite.
    pub fn new(zones: u32, trips: &[Trip]) -> Result<Self> {
        let mut sorted = trips.to_vec();
        sorted.sort_by_key(|trip| (trip.origin, trip.destination));
        let mut demand = Self {
            zones,
            origins: Vec::new(),
            total: 0.0,
            intrazonal: 0.0,
        };
        for trip in sorted {
            let place = format!("trips from {} to {}", trip.origin, trip.destination);
            for zone in [trip.origin, trip.destination] {
                if !(1..=zones).contains(&zone) {
                    return Err(Error::input(place, zone, format!("a zone from 1 to {zones}")));
                }
            }
            check_not_negative(&place, trip.volume)?;
            demand.add(trip);
        }
        if !demand.total.is_finite() {
            return Err(Error::input("trips", "a sum that overflows", "a finite total"));
        }
        Ok(demand)
    }

    /// Adds a checked trip; they come by ascending origin and destination.
    fn add(&mut self, trip: Trip) {
        if trip.origin == trip.destination {
            self.intrazonal += trip.volume;
            return;
        }
        if trip.volume == 0.0 {
            return;
        }
        self.total += trip.volume;
        let (origin, destination) = (trip.origin - 1, trip.destination - 1);
        if self.origins.last().is_none_or(|last| last.origin != origin) {
            self.origins.push(OriginDemand {
                origin,
                destinations: Vec::new(),
            });
        }
        if let Some(last) = self.origins.last_mut() {
            match last.destinations.last_mut() {
                Some((previous, volume)) if *previous == destination => *volume += trip.volume,
                _ => last.destinations.push((destination, trip.volume)),
            }
        }
    }

    /// Number of zones that the table is for.
    pub fn zones(&self) -> u32 {
        self.zones
    }

    /// Vehicles per unit of time on the network: the sum of the table without intrazonal trips.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Vehicles per unit of time that stay within their zone and were dropped.
    pub fn intrazonal(&self) -> f64 {
        self.intrazonal
    }

    /// Number of origin-destination pairs with demand between them.
    pub fn pairs(&self) -> usize {
        self.origins.iter().map(|origin| origin.destinations.len()).sum()
    }

    /// Every pair with demand, by ascending origin and destination.
    pub fn trips(&self) -> impl Iterator<Item = Trip> + '_ {
        self.origins.iter().flat_map(|from| {
            from.destinations.iter().map(|&(destination, volume)| Trip {
                origin: from.origin + 1,
                destination: destination + 1,
                volume,
            })
        })
    }

    /// These trips without some pairs of origin and destination.
    #[cfg(feature = "formats")]
    pub(crate) fn without(&self, pairs: &HashSet<(u32, u32)>) -> Result<Self> {
        let kept = self
            .trips()
            .filter(|trip| !pairs.contains(&(trip.origin, trip.destination)));
        let rest = Self::new(self.zones, &kept.collect::<Vec<_>>())?;
        Ok(Self {
            intrazonal: self.intrazonal,
            ..rest
        })
    }

    /// All these trips together; they are for the same zones.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn merged(demands: &[Self]) -> Result<Self> {
        let zones = demands.iter().map(|demand| demand.zones).max().unwrap_or(0);
        let trips: Vec<Trip> = demands.iter().flat_map(Self::trips).collect();
        Ok(Self {
            intrazonal: demands.iter().map(|demand| demand.intrazonal).sum(),
            ..Self::new(zones, &trips)?
        })
    }

    /// So many times these trips.
    ///
    /// # Errors
    /// [`Error::Input`] for a factor that is negative or not finite, or a total that overflows.
    pub fn scaled(&self, factor: f64) -> Result<Self> {
        check_not_negative("demand factor", factor)?;
        let trips: Vec<Trip> = self
            .trips()
            .map(|trip| Trip {
                volume: factor * trip.volume,
                ..trip
            })
            .collect();
        let scaled = Self::new(self.zones, &trips)?;
        Ok(Self {
            intrazonal: factor * self.intrazonal,
            ..scaled
        })
    }

    /// Origins with any demand, by ascending zone.
    pub(crate) fn origins(&self) -> &[OriginDemand] {
        &self.origins
    }
}
