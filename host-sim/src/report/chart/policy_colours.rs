//! One colour for a policy in figures, reports and terminals, and a brighter one for a dark ground. The page has the same
//! (`web/page/style.css`).

use super::canvas::{Colour, INK};

/// By policy. Chosen: near Okabe and Ito's blue, green and vermillion for what is compared most, kin near each other (actor and clock,
/// central and max-weight, both ALOHAs), and a contrast of 4.5 with white, as text needs;
/// then the same hues with a contrast of 7 with a dark ground.
const COLOURS: [(&str, Colour, Colour); 11] = [
    ("actor", Colour(0, 114, 178), Colour(108, 184, 230)),
    ("clock", Colour(44, 121, 173), Colour(164, 211, 242)),
    ("central", Colour(0, 135, 95), Colour(31, 201, 151)),
    ("max-weight", Colour(63, 127, 79), Colour(143, 199, 156)),
    ("assigned", Colour(75, 59, 156), Colour(167, 155, 234)),
    ("grants", Colour(140, 86, 168), Colour(203, 161, 224)),
    ("sps", Colour(138, 43, 87), Colour(224, 139, 178)),
    ("age-threshold", Colour(154, 106, 0), Colour(232, 176, 58)),
    ("aloha", Colour(196, 85, 0), Colour(242, 129, 58)),
    ("random", Colour(107, 112, 120), Colour(163, 171, 179)),
    ("always", Colour(184, 72, 135), Colour(240, 149, 198)),
];

/// The colour of the policy of this name, or of the bound that stands beside policies; `None` for whatever else a figure shows. A
/// label may say more, before or behind a colon.
pub fn of(name: &str) -> Option<Colour> {
    let named = |part: &str| match part {
        "bound" => Some(INK),
        _ => {
            let found = COLOURS.iter().find(|(policy, ..)| *policy == part);
            found.map(|&(_, colour, _)| colour)
        }
    };
    name.split(": ").find_map(named)
}

/// Every policy's colour on white, and on a dark ground.
pub(super) fn pairs() -> impl Iterator<Item = (Colour, Colour)> {
    COLOURS.iter().map(|&(_, light, dark)| (light, dark))
}

#[cfg(test)]
mod tests {
    use super::{COLOURS, of};
    use crate::policy::KINDS;
    use std::path::{Path, PathBuf};

    #[test]
    fn every_policy_has_a_colour_of_its_own_the_page_s() {
        let style = include_str!("../../../../web/page/style.css");
        let (light, dark) = style.split_once("@media (prefers-color-scheme: dark)").unwrap();
        assert_eq!(COLOURS.len(), KINDS.len());
        for kind in KINDS {
            let found: Vec<_> = COLOURS.iter().filter(|(name, ..)| *name == kind.name).collect();
            assert_eq!(found.len(), 1, "{}", kind.name);
            let (name, colour, on_dark) = found[0];
            assert!(
                light.contains(&format!("--policy-{name}: {colour};")),
                "{name}: {colour}"
            );
            assert!(
                dark.contains(&format!("--policy-{name}: {on_dark};")),
                "{name}: {on_dark}"
            );
            assert_eq!(
                COLOURS.iter().filter(|(_, other, _)| other == colour).count(),
                1,
                "{name}"
            );
        }
    }

    /// All but those in which no mark is a policy's. A bar, or a line with its mark, stands before its name.
    #[test]
    fn figures_of_the_book_have_these_colours() {
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
        let paths = std::fs::read_dir(docs)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let others = ["data-flow.svg", "decisions_at_6.svg", "race_to_5_ms.svg"];
        let is_figure = |path: &PathBuf| {
            path.extension().is_some_and(|end| end == "svg")
                && !others.iter().any(|name| path.ends_with(name))
        };
        let figures: Vec<PathBuf> = paths.filter(is_figure).collect();
        assert!(figures.len() > 4, "{figures:?}");
        for path in figures {
            let svg = std::fs::read_to_string(&path).unwrap();
            let elements: Vec<&str> = svg.split('<').filter(|part| !part.starts_with('/')).collect();
            let mut names = 0;
            for part in elements.windows(4) {
                let (marks, text) = part.split_at(3);
                let name = text[0].rsplit('>').next().unwrap_or_default();
                if let Some(colour) = of(name).filter(|_| name != "bound") {
                    let own = [colour, colour.tint()].map(|colour| format!("=\"{colour}\""));
                    let has = |mark: &&str| own.iter().any(|own| mark.contains(own));
                    assert!(marks.iter().any(has), "{}: {name}: {marks:?}", path.display());
                    names += 1;
                }
            }
            assert!(names > 1, "{}", path.display());
        }
    }
}
