//! One colour for a policy in every figure. The page has the same, beside brighter ones for a dark ground (`web/page/style.css`).

use super::canvas::{Colour, INK};

/// By policy. Chosen: near Okabe and Ito's blue, green and vermillion for what is compared most, kin near each other (actor and clock,
/// central and max-weight, both ALOHAs), and a contrast of 4.5 with white, as text needs.
const COLOURS: [(&str, Colour); 11] = [
    ("actor", Colour(0, 114, 178)),
    ("clock", Colour(44, 121, 173)),
    ("central", Colour(0, 135, 95)),
    ("max-weight", Colour(63, 127, 79)),
    ("assigned", Colour(75, 59, 156)),
    ("grants", Colour(140, 86, 168)),
    ("sps", Colour(138, 43, 87)),
    ("age-threshold", Colour(154, 106, 0)),
    ("aloha", Colour(196, 85, 0)),
    ("random", Colour(107, 112, 120)),
    ("always", Colour(184, 72, 135)),
];

/// The colour of the policy of this name, or of the bound that stands beside policies; `None` for whatever else a figure shows.
pub(super) fn of(name: &str) -> Option<Colour> {
    if name == "bound" {
        return Some(INK);
    }
    let found = COLOURS.iter().find(|(policy, _)| *policy == name);
    found.map(|&(_, colour)| colour)
}

#[cfg(test)]
mod tests {
    use super::COLOURS;
    use crate::policy::KINDS;

    #[test]
    fn every_policy_has_a_colour_of_its_own_the_page_s() {
        let style = include_str!("../../../../web/page/style.css");
        let light = style
            .split("@media (prefers-color-scheme: dark)")
            .next()
            .unwrap_or_default();
        assert_eq!(COLOURS.len(), KINDS.len());
        for kind in KINDS {
            let found: Vec<_> = COLOURS.iter().filter(|(name, _)| *name == kind.name).collect();
            assert_eq!(found.len(), 1, "{}", kind.name);
            let (name, colour) = found[0];
            assert!(
                light.contains(&format!("--policy-{name}: {colour};")),
                "{name}: {colour}"
            );
            assert_eq!(
                COLOURS.iter().filter(|(_, other)| other == colour).count(),
                1,
                "{name}"
            );
        }
    }
}
