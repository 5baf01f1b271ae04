//! Which vehicles are present in which world of a batch.

use crate::lanes::Rows;
use crate::mobility::Place;

/// The vehicles of a batch of worlds in one slot.
#[derive(Clone, Debug)]
pub struct Presence {
    /// Every vehicle that is present in some world, ascending. Where worlds differ these are all that there is room for, so
    /// that a world's random streams do not depend on the worlds beside it.
    vehicles: Vec<usize>,
    /// 1 where a vehicle is present, `[vehicle][world]`; `None` while every listed vehicle is present in every world.
    here: Option<Rows<u8>>,
}

impl Presence {
    /// Nobody yet. `differs` says that worlds may have different vehicles, for which there is room for `vehicles`.
    pub(crate) fn new(worlds: usize, vehicles: usize, differs: bool) -> Self {
        Self {
            vehicles: if differs {
                (0..vehicles).collect()
            } else {
                Vec::new()
            },
            here: differs.then(|| Rows::new(worlds, vehicles, 0)),
        }
    }

    /// Nobody any more.
    pub(crate) fn reset(&mut self) {
        match &mut self.here {
            Some(here) => here.fill_all(0),
            None => self.vehicles.clear(),
        }
    }

    /// The vehicles, ascending. Where worlds differ, not every one of them is [here](Presence::rows) in every world.
    #[inline(always)]
    pub fn vehicles(&self) -> &[usize] {
        &self.vehicles
    }

    /// 1 where a vehicle is present, `[vehicle][world]`; `None` if every vehicle of the list is present in every world.
    #[inline(always)]
    pub fn rows(&self) -> Option<&Rows<u8>> {
        self.here.as_ref()
    }

    /// Whether a vehicle is present in a world.
    pub fn contains(&self, world: usize, vehicle: usize) -> bool {
        match &self.here {
            Some(here) => here.get(world, vehicle) > 0,
            None => self.vehicles.binary_search(&vehicle).is_ok(),
        }
    }

    /// How many vehicles are present in a world.
    pub fn count(&self, world: usize) -> usize {
        match &self.here {
            Some(here) => {
                let here = |vehicle: &&usize| here.get(world, **vehicle) > 0;
                self.vehicles.iter().filter(here).count()
            }
            None => self.vehicles.len(),
        }
    }

    /// Takes in the places of those who are present in a world from now on, by ascending vehicle, and finds who arrived and who
    /// departed. Where worlds do not differ, what is found holds for all of them.
    pub(crate) fn update(
        &mut self,
        world: usize,
        places: &[(usize, Place)],
        arrivals: &mut Vec<usize>,
        departures: &mut Vec<usize>,
    ) {
        let now = |vehicle: &usize| places.binary_search_by_key(vehicle, |&(known, _)| known).is_ok();
        let vehicles = places.iter().map(|&(vehicle, _)| vehicle);
        arrivals.clear();
        arrivals.extend(vehicles.clone().filter(|&vehicle| !self.contains(world, vehicle)));
        departures.clear();
        let before = self.vehicles.iter().copied();
        departures.extend(before.filter(|vehicle| self.contains(world, *vehicle) && !now(vehicle)));
        match &mut self.here {
            Some(here) => {
                arrivals.iter().for_each(|&vehicle| here.set(world, vehicle, 1));
                departures.iter().for_each(|&vehicle| here.set(world, vehicle, 0));
            }
            None => {
                self.vehicles.clear();
                self.vehicles.extend(vehicles);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mobility::Place;

    #[test]
    fn who_comes_and_goes_is_found_in_each_world() {
        let places = |vehicles: &[usize]| -> Vec<(usize, Place)> {
            vehicles
                .iter()
                .map(|&vehicle| (vehicle, Place::default()))
                .collect()
        };
        for differs in [false, true] {
            let mut presence = Presence::new(2, 4, differs);
            let (mut arrivals, mut departures) = (Vec::new(), Vec::new());
            for (present, came, went) in [
                (vec![0, 2], vec![0, 2], vec![]),
                (vec![2, 3], vec![3], vec![0]),
                (vec![2], vec![], vec![3]),
            ] {
                presence.update(1, &places(&present), &mut arrivals, &mut departures);
                assert_eq!((&arrivals, &departures), (&came, &went));
                assert_eq!(presence.count(1), present.len());
                for vehicle in 0..4 {
                    assert_eq!(presence.contains(1, vehicle), present.contains(&vehicle));
                    assert!(!differs || !presence.contains(0, vehicle));
                }
            }
        }
    }
}
