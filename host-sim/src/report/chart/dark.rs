//! The dark palette: which colour stands on a dark ground for which of the figures' own. A page that holds figures replaces them by
//! its style sheet, so that a figure's file stays what it is.
//!
//! The colours of maps are not among them: they are a scale, from dark for the least to light for the largest on any ground.

use super::bar::BAR_COLOURS;
use super::canvas::{Colour, FAINT, GREY, INK, PALETTE, WHITE};
use super::policy_colours;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The dark ground.
const GROUND: Colour = Colour(22, 22, 22);

/// What stands there for the palette (chosen: the same hues, with a contrast of 7 with the ground and more).
const ON_DARK: [Colour; 8] = [
    Colour(108, 184, 230),
    Colour(242, 129, 58),
    Colour(31, 201, 151),
    Colour(216, 147, 184),
    Colour(228, 228, 228),
    Colour(240, 180, 60),
    Colour(159, 214, 245),
    Colour(240, 228, 66),
];

/// Every colour of figures with its like, by how it is written.
fn pairs() -> BTreeMap<String, Colour> {
    let whole = [
        (WHITE, GROUND),
        (INK, Colour(228, 228, 228)),
        (GREY, Colour(168, 168, 168)),
        (FAINT, Colour(58, 58, 58)),
    ];
    let palette = PALETTE.into_iter().zip(ON_DARK);
    let bars = BAR_COLOURS.into_iter().zip(ON_DARK);
    let bars = bars.map(|((_, bar), on_dark)| (bar, on_dark.towards(GROUND)));
    let policies = policy_colours::pairs();
    let policies = policies.flat_map(|(light, dark)| [(light, dark), (light.tint(), dark.towards(GROUND))]);
    let pairs = whole.into_iter().chain(palette).chain(bars).chain(policies);
    pairs.map(|(light, dark)| (light.to_string(), dark)).collect()
}

/// Rules of a style sheet for figures on a dark ground.
pub fn style() -> String {
    let mut rules = String::new();
    for (light, dark) in pairs() {
        for attribute in ["fill", "stroke"] {
            // Writing to a string cannot fail.
            let _ = writeln!(
                rules,
                "figure [{attribute}=\"{light}\"] {{ {attribute}: {dark}; }}"
            );
        }
    }
    rules
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::chart::{
        Axis, Bar, BarChart, LineChart, OccupancyChart, OccupancyGroup, Reference, Series, SlotUse,
    };

    /// Whatever has a colour, by name and value.
    fn colours(svg: &str) -> Vec<&str> {
        let values = svg.split("=\"").skip(1).filter_map(|rest| rest.split('"').next());
        values.filter(|value| value.starts_with('#')).collect()
    }

    #[test]
    fn every_colour_of_a_figure_has_its_like() {
        let names = ["actor", "protocol: central", "else"];
        let reference = Reference {
            name: "bound".to_owned(),
            value: 2.0,
        };
        let bars = names.map(|name| Bar {
            name: name.to_owned(),
            value: 3.0,
            interval: Some((2.5, 3.5)),
            emphasised: name == "else",
        });
        let bar = BarChart {
            title: "Bars".to_owned(),
            note: "Note.".to_owned(),
            axis: Axis::linear("ms"),
            decimals: 1,
            bars: bars.into(),
            reference: Some(reference.clone()),
        };
        let lines = |count: usize| LineChart {
            title: "Lines".to_owned(),
            note: String::new(),
            horizontal: Axis::linear("ms"),
            vertical: Axis::linear("ms"),
            series: (0..count)
                .map(|index| Series {
                    name: names.get(index).unwrap_or(&"more").to_string(),
                    points: vec![(1.0, index as f64).into(), (2.0, 1.0).into()],
                })
                .collect(),
            references: vec![reference.clone()],
        };
        let uses = [
            SlotUse::Received,
            SlotUse::Captured,
            SlotUse::Collided,
            SlotUse::Faded,
            SlotUse::Idle,
        ];
        let occupancy = OccupancyChart {
            title: "Use".to_owned(),
            note: String::new(),
            first_slot: 0,
            groups: vec![OccupancyGroup {
                name: "actor".to_owned(),
                rows: vec![uses.to_vec()],
            }],
        };
        let known = pairs();
        for svg in [
            bar.to_svg().unwrap(),
            lines(2).to_svg().unwrap(),
            lines(9).to_svg().unwrap(),
            occupancy.to_svg().unwrap(),
        ] {
            assert!(colours(&svg).len() > 10);
            for colour in colours(&svg) {
                assert!(known.contains_key(colour), "{colour}");
            }
        }
    }
}
