//! Cells to learn in: one, or a mixture of several. A cell is taken as it is described, at one of some loads, or varied: every time
//! it is drawn, another load, link budget and number of sub-channels, and other imperfections.

use crate::evaluate::Setting;
use firmware::units::MAX_SUB_CHANNELS;
use host_sim::scenario::{Preset, Scenario, ScenarioSource};
use host_sim::stream::Stream;
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use kit::keys;
use kit::layers::sets;
use serde::{Deserialize, Serialize};
use toml::Table;

/// Most sub-channels of a varied cell: what a table that was learned there serves (chosen: two and a half times the paper's).
pub const VARIED_SUB_CHANNELS: u32 = 8;

/// Most cells of a mixture (chosen).
pub const CELLS: usize = 16;

/// Most settings of a cell (chosen).
const SETTINGS: usize = 100;

keys! {
    /// A mixture, alone in a file.
    pub struct MixtureSource {
        /// Cells to learn in.
        #[key(longest = CELLS, source = "chosen")]
        pub mixture: Vec<CellSource>,
    }

    /// One cell of a mixture.
    pub struct CellSource {
        /// Scenario of the simulator to start from. Needed.
        #[key(source = "chosen")]
        pub preset: Option<Preset>,
        /// How many worlds are of this cell, beside the other weights. Needed.
        #[key(range = 1e-6..=1e6, source = "chosen")]
        pub weight: Option<f64>,
        /// What reports call the cell: letters, digits, hyphens and underscores. Without it the preset's name.
        #[key(source = "chosen")]
        pub name: Option<String>,
        /// Settings of this cell alone, such as "radio.sub_channels=4"; what is set for all cells lies below them.
        #[key(longest = SETTINGS, source = "chosen")]
        pub set: Option<Vec<String>>,
        /// Fewest and most vehicles, of which every draw takes a number. Without it the algorithm's.
        #[key(range = 1.0..=300.0, unit = "vehicles", source = "chosen")]
        pub vehicles: Option<[u32; 2]>,
        /// Whether every draw is another cell around this one, as `trainer distil` learns in: loads, link budget, 1 to 8
        /// sub-channels, lost places, late and lost feedback, old gains, fading, standing vehicles.
        #[key(source = "chosen")]
        pub varied: Option<bool>,
    }
}

/// One cell, checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MixedCell {
    /// What reports call it.
    pub name: String,
    /// How many worlds are of this cell, beside the other weights.
    pub weight: f64,
    /// Fewest and most vehicles.
    pub vehicles: [u32; 2],
    /// Whether every draw varies it.
    pub varied: bool,
    /// The cell.
    pub scenario: Scenario,
}

/// At least one cell; all ask for the same SINR, by which actors scale what they see and send.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture(Vec<MixedCell>);

impl MixedCell {
    /// One of its cells.
    pub fn draw(&self, stream: &mut Stream) -> Scenario {
        let mut scenario = self.scenario.clone();
        let [least, most] = self.vehicles;
        if self.varied {
            vary(&mut scenario, self.vehicles, stream);
        } else {
            scenario.cell.vehicles = least + stream.below(most - least + 1);
        }
        scenario
    }

    /// Most sub-channels of its cells.
    fn sub_channels(&self) -> u32 {
        match (self.varied, self.scenario.radio.sub_channels) {
            (true, own) => own.max(VARIED_SUB_CHANNELS),
            (false, own) => own,
        }
    }
}

impl Mixture {
    /// One cell alone, with so many vehicles, taken as it is.
    pub fn alone(scenario: &Scenario, vehicles: [u32; 2]) -> Self {
        Self(vec![MixedCell {
            name: "scenario".to_owned(),
            weight: 1.0,
            vehicles,
            varied: false,
            scenario: scenario.clone(),
        }])
    }

    /// The same, varied.
    pub fn varied(scenario: &Scenario, vehicles: [u32; 2]) -> Self {
        let mut mixture = Self::alone(scenario, vehicles);
        mixture.0[0].varied = true;
        mixture
    }

    /// Cells that were checked when they were read.
    pub(crate) const fn of(cells: Vec<MixedCell>) -> Self {
        Self(cells)
    }

    /// Reads and checks cells. `common` gives a preset with what is set for all cells, and `vehicles` how many there are of
    /// where a cell does not say.
    ///
    /// # Errors
    /// The first cell's key that does not fit.
    pub fn read(
        sources: &[CellSource],
        vehicles: [u32; 2],
        common: impl Fn(Preset) -> Result<Table>,
    ) -> Result<Self> {
        let mut cells: Vec<MixedCell> = Vec::new();
        for (index, source) in sources.iter().enumerate() {
            let cell = source.read(&place(index), vehicles, &common)?;
            cell.check(&place(index), &cells)?;
            cells.push(cell);
        }
        if cells.is_empty() {
            return Err(Error::input("mixture", "no cell", "at least one"));
        }
        Ok(Self(cells))
    }

    /// The cells.
    pub fn cells(&self) -> &[MixedCell] {
        &self.0
    }

    /// Whether there are several.
    pub fn is_mixed(&self) -> bool {
        self.0.len() > 1
    }

    /// One of its cells: one by weight, and one of that one's.
    pub fn draw(&self, stream: &mut Stream) -> Scenario {
        let at = if self.is_mixed() { stream.uniform() } else { 0.0 };
        self.0[self.at(f64::from(at))].draw(stream)
    }

    /// Which cell each of so many parts is of: shares as the weights say, the first cell first.
    pub fn split(&self, parts: usize) -> Vec<usize> {
        let middle = |part: usize| (part as f64 + 0.5) / parts as f64;
        (0..parts).map(|part| self.at(middle(part))).collect()
    }

    /// The cell whose interval of the cumulated weights holds a point of 0 to 1.
    fn at(&self, point: f64) -> usize {
        let sum: f64 = self.0.iter().map(|cell| cell.weight).sum();
        let mut left = point * sum;
        for (index, cell) in self.0.iter().enumerate() {
            left -= cell.weight;
            if left < 0.0 {
                return index;
            }
        }
        self.0.len() - 1
    }

    /// Fewest and most vehicles of any cell.
    pub fn vehicles(&self) -> [u32; 2] {
        let both = |a: [u32; 2], b: [u32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let mut ranges = self.0.iter().map(|cell| cell.vehicles);
        ranges.next().map_or([1, 1], |first| ranges.fold(first, both))
    }

    /// Most sub-channels of any cell.
    pub fn sub_channels(&self) -> u32 {
        self.0.iter().map(MixedCell::sub_channels).max().unwrap_or(1)
    }

    /// What actors see and do in all of its cells.
    pub fn setting(&self) -> Setting {
        Setting::of_scenario(&self.0[0].scenario)
    }
}

/// What errors call a cell.
pub(crate) fn place(index: usize) -> String {
    format!("mixture[{index}]")
}

impl CellSource {
    fn read(
        &self,
        place: &str,
        vehicles: [u32; 2],
        common: &impl Fn(Preset) -> Result<Table>,
    ) -> Result<MixedCell> {
        let needed = |key: &str, expected: String| Error::input(format!("{place}.{key}"), "none", expected);
        let key = |name: &str| Self::KEYS.iter().find(|key| key.name == name);
        let range = |name: &str| key(name).map_or_else(String::new, kit::keys::Key::range);
        let preset = self.preset.ok_or_else(|| needed("preset", range("preset")))?;
        let weight = self.weight.ok_or_else(|| needed("weight", range("weight")))?;
        let settings = self.set.clone().unwrap_or_default();
        for (index, setting) in settings.iter().enumerate() {
            let name = setting.split('=').next().unwrap_or_default().trim();
            if settings[..index].iter().any(|other| sets(other, name)) {
                let found = format!("{name} twice");
                return Err(Error::input(format!("{place}.set"), found, "each key once"));
            }
        }
        let scenario = ScenarioSource {
            preset,
            file: None,
            values: common(preset)?,
            settings,
        };
        Ok(MixedCell {
            name: self.name.clone().unwrap_or_else(|| preset.name().to_owned()),
            weight,
            vehicles: self.vehicles.unwrap_or(vehicles),
            varied: self.varied.unwrap_or(false),
            scenario: scenario.read().map_err(|error| error.within(place))?,
        })
    }
}

impl MixedCell {
    /// Checks its keys against each other and those of the cells before.
    fn check(&self, place: &str, before: &[Self]) -> Result<()> {
        let known = |character: char| character.is_ascii_alphanumeric() || "-_".contains(character);
        if self.name.is_empty() || !self.name.chars().all(known) {
            let expected = "letters, digits, hyphens and underscores";
            return Err(Error::input(
                format!("{place}.name"),
                format!("{:?}", self.name),
                expected,
            ));
        }
        if before.iter().any(|cell| cell.name == self.name) {
            let found = format!("\"{}\" twice", self.name);
            return Err(Error::input(
                format!("{place}.name"),
                found,
                "a name of each cell's own",
            ));
        }
        let [least, most] = self.vehicles;
        if least > most {
            let found = format!("{least} to {most}");
            return Err(Error::input(
                format!("{place}.vehicles"),
                found,
                "the fewest first",
            ));
        }
        let radio = &self.scenario.radio;
        let most_sub_channels = if self.varied {
            VARIED_SUB_CHANNELS
        } else {
            MAX_SUB_CHANNELS as u32
        };
        if radio.sub_channels > most_sub_channels {
            let expected = match self.varied {
                true => format!("at most {most_sub_channels}, as a varied cell has"),
                false => format!("at most {most_sub_channels}, which units know"),
            };
            let key = format!("{place}: radio.sub_channels");
            return Err(Error::input(key, radio.sub_channels, expected));
        }
        let first = before.first().unwrap_or(self);
        if radio.required_level() != first.scenario.radio.required_level() {
            let rate = |cell: &Self| cell.scenario.radio.min_spectral_efficiency;
            let expected = format!("{}, as the cell \"{}\" has", rate(first), first.name);
            let key = format!("{place}: radio.min_spectral_efficiency");
            return Err(Error::input(key, rate(self), expected));
        }
        Ok(())
    }
}

/// Makes another cell of one: any load, number of sub-channels and link budget, with and without places, and what a street brings
/// (shares are chosen).
fn vary(scenario: &mut Scenario, vehicles: [u32; 2], stream: &mut Stream) {
    let [least, most] = vehicles.map(f64::from);
    // Loads whose ratios are alike are equally frequent.
    let drawn = least * libm::pow((most + 1.0) / least, f64::from(stream.uniform()));
    scenario.cell.vehicles = (drawn as u32).clamp(vehicles[0], vehicles[1]);
    let mut either = |share: f64, value: f64, other: f64| if stream.chance(share) { value } else { other };
    let radio = &mut scenario.radio;
    radio.max_power_dbm = either(0.5, radio.max_power_dbm, 23.0);
    radio.carrier_ghz = either(0.5, radio.carrier_ghz, 5.9);
    let feedback = &mut scenario.feedback;
    let lost = either(0.5, 0.3, 1.0);
    feedback.place_loss = either(0.4, 0.0, lost);
    feedback.acknowledgement_delay_slots = either(0.5, 0.0, 4.0) as u32;
    feedback.acknowledgement_loss = either(0.5, 0.0, 0.05);
    scenario.knowledge.gain_delay_slots = either(0.5, 0.0, 4.0) as u32;
    scenario.knowledge.gain_error_db = either(0.5, 0.0, 2.0);
    scenario.mobility.standing_share = either(0.5, 0.0, 0.3);
    scenario.fading.follows_speed = either(0.5, 0.0, 1.0) > 0.0;
    if stream.chance(0.5) {
        scenario.radio.sub_channels = 1 + stream.below(VARIED_SUB_CHANNELS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distil::{VEHICLES, table::shipped_mixture};
    use crate::laboratory::random;

    #[test]
    fn a_varied_cell_holds_every_kind_of_cell() {
        let shipped = shipped_mixture().unwrap();
        let mut stream = random::initial(1, 0);
        let cells: Vec<Scenario> = (0..2000).map(|_| shipped.draw(&mut stream)).collect();
        for cell in &cells {
            cell.check().unwrap();
        }
        let share = |holds: &dyn Fn(&Scenario) -> bool| {
            cells.iter().filter(|cell| holds(cell)).count() as f64 / cells.len() as f64
        };
        for sub_channels in 1..=VARIED_SUB_CHANNELS {
            let expected = if sub_channels == 3 {
                0.5 + 1.0 / 16.0
            } else {
                1.0 / 16.0
            };
            let found = share(&|cell| cell.radio.sub_channels == sub_channels);
            assert!((found - expected).abs() < 0.04, "{sub_channels}: {found}");
        }
        // Half of the loads are below the square root of the largest.
        let few = share(&|cell| cell.cell.vehicles < 17);
        assert!((few - 0.5).abs() < 0.04, "{few}");
        assert!(
            cells
                .iter()
                .all(|cell| (VEHICLES[0]..=VEHICLES[1]).contains(&cell.cell.vehicles))
        );
        let places = [0.0, 0.3, 1.0].map(|loss| share(&|cell| cell.feedback.place_loss == loss));
        assert!(
            places.iter().all(|share| (share - 0.35).abs() < 0.1),
            "{places:?}"
        );
        let late = share(&|cell| cell.knowledge.gain_delay_slots > 0 && cell.fading.follows_speed);
        assert!((late - 0.25).abs() < 0.04, "{late}");
    }

    fn read(text: &str) -> Result<Mixture> {
        let source: MixtureSource = toml::from_str(text).unwrap();
        Mixture::read(&source.mixture, [3, 72], |preset| Ok(preset.values()))
    }

    #[test]
    fn worlds_are_shared_by_weight() {
        let mixture = read(
            "mixture = [{ preset = \"paper\", weight = 2 }, { preset = \"street\", weight = 1, vehicles = [80, 90] },
             { preset = \"edge\", weight = 5, set = [\"radio.sub_channels=4\"] }]",
        )
        .unwrap();
        assert_eq!(mixture.split(8), [0, 0, 1, 2, 2, 2, 2, 2]);
        assert_eq!(mixture.split(24).iter().filter(|&&cell| cell == 1).count(), 3);
        assert_eq!((mixture.vehicles(), mixture.sub_channels()), ([3, 90], 4));
        let names: Vec<&str> = mixture.cells().iter().map(|cell| cell.name.as_str()).collect();
        assert_eq!(names, ["paper", "street", "edge"]);
        // Draws keep to the weights and to each cell's loads.
        let mut stream = random::initial(1, 0);
        let cells: Vec<Scenario> = (0..4000).map(|_| mixture.draw(&mut stream)).collect();
        let street = |cell: &&Scenario| cell.fading.follows_speed;
        let edge = |cell: &&Scenario| cell.radio.max_power_dbm == 23.0;
        let share = cells.iter().filter(edge).count() as f64 / cells.len() as f64;
        assert!((share - 5.0 / 8.0).abs() < 0.03, "{share}");
        assert!(
            cells
                .iter()
                .filter(street)
                .all(|cell| (80..=90).contains(&cell.cell.vehicles))
        );
        assert!(
            cells.iter().filter(edge).all(|cell| cell.radio.sub_channels == 4
                && cell.cell.vehicles >= 3
                && cell.cell.vehicles <= 72)
        );
    }

    #[test]
    fn bad_cells_are_named() {
        for (cells, expected) in [
            ("", "mixture: found no cell, expected at least one"),
            (
                "{ weight = 1 }",
                "mixture[0].preset: found none, expected \"paper\", \"companion\", \"street\", \"edge\"",
            ),
            (
                "{ preset = \"paper\", weight = 1 }, { preset = \"edge\" }",
                "mixture[1].weight: found none, expected 1e-6 to 1e6",
            ),
            (
                "{ preset = \"edge\", weight = 1 }, { preset = \"edge\", weight = 1 }",
                "mixture[1].name: found \"edge\" twice, expected a name of each cell's own",
            ),
            (
                "{ preset = \"edge\", weight = 1, name = \"a,b\" }",
                "mixture[0].name: found \"a,b\", expected letters, digits, hyphens and underscores",
            ),
            (
                "{ preset = \"edge\", weight = 1, vehicles = [9, 8] }",
                "mixture[0].vehicles: found 9 to 8, expected the fewest first",
            ),
            (
                "{ preset = \"edge\", weight = 1, set = [\"radio.sub_channels=3\", \"radio.sub_channels=4\"] }",
                "mixture[0].set: found radio.sub_channels twice, expected each key once",
            ),
            (
                "{ preset = \"edge\", weight = 1, set = [\"radio.sub_channels=17\"] }",
                "mixture[0]: radio.sub_channels: found 17, expected at most 16, which units know",
            ),
            (
                "{ preset = \"edge\", weight = 1, varied = true, set = [\"radio.sub_channels=9\"] }",
                "mixture[0]: radio.sub_channels: found 9, expected at most 8, as a varied cell has",
            ),
            (
                "{ preset = \"edge\", weight = 1, set = [\"cell.vehicles=0\"] }",
                "mixture[0]: cell.vehicles: found 0, expected 1 to 10000 vehicles",
            ),
            (
                "{ preset = \"paper\", weight = 1 },
                 { preset = \"edge\", weight = 1, set = [\"radio.min_spectral_efficiency=2\"] }",
                "mixture[1]: radio.min_spectral_efficiency: found 2, expected 3, as the cell \"paper\" has",
            ),
        ] {
            let error = read(&format!("mixture = [{cells}]")).unwrap_err();
            assert_eq!(error.to_string(), expected);
        }
    }
}
