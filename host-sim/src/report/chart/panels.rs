//! Several figures side by side in one.

use std::fmt::Write as _;

/// Puts figures next to each other, from left to right, tops aligned. They are SVG texts with width and height in pixels, as
/// the charts give them; what has neither is left out.
pub fn side_by_side(figures: &[String]) -> String {
    let (mut width, mut height) = (0.0, 0.0_f64);
    let mut panels = String::new();
    for figure in figures {
        let Some((panel_width, panel_height)) = number(figure, "width").zip(number(figure, "height")) else {
            continue;
        };
        // Writing to a string cannot fail.
        let _ = writeln!(
            panels,
            "{}",
            figure
                .trim_end()
                .replacen("<svg ", &format!("<svg x=\"{width}\" "), 1)
        );
        width += panel_width;
        height = height.max(panel_height);
    }
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{panels}</svg>\n"
    )
}

/// The first number that an attribute has.
fn number(figure: &str, attribute: &str) -> Option<f64> {
    let (_, value) = figure.split_once(&format!(" {attribute}=\""))?;
    value.split_once('"')?.0.parse().ok()
}
