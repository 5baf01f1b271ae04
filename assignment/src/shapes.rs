//! How roads run, as lines of points.

use std::fmt::Write as _;

/// Points of a line, eastwards and northwards; empty for a straight line between a road's nodes.
pub type Shape = Vec<(f64, f64)>;

/// The points of a line in well-known text, `LINESTRING (x y, x y)`; those of several lines one after the other. None for
/// anything else.
pub fn parse_wkt(text: &str) -> Option<Shape> {
    let (word, points) = text.split_once('(')?;
    if !word.to_ascii_uppercase().contains("LINESTRING") {
        return None;
    }
    parse_points(points.trim_end().trim_end_matches(')'), ',')
}

/// Points `x y`, or `x,y` in SUMO's files, each with or without a height.
pub(crate) fn parse_points(text: &str, between: char) -> Option<Shape> {
    let within = |c: char| c != between && (c.is_whitespace() || c == ',');
    let mut shape = Shape::new();
    for point in text
        .split(between)
        .map(|point| point.trim_matches(['(', ')', ' ']))
    {
        let mut numbers = point.split(within).filter(|number| !number.is_empty());
        let x = numbers.next()?.parse::<f64>().ok()?;
        let y = numbers.next()?.parse::<f64>().ok()?;
        if !(x.is_finite() && y.is_finite()) {
            return None;
        }
        shape.push((x, y));
    }
    (shape.len() > 1).then_some(shape)
}

/// A line in well-known text.
pub fn format_wkt(shape: &[(f64, f64)]) -> String {
    let mut text = String::from("LINESTRING (");
    for (index, (x, y)) in shape.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = write!(text, "{}{x} {y}", if index > 0 { ", " } else { "" });
    }
    text + ")"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_as_they_are_written() {
        let line = "LINESTRING (0 0.5, -1 2)";
        assert_eq!(format_wkt(&parse_wkt(line).unwrap()), line);
        assert_eq!(
            parse_wkt("MULTILINESTRING ((1 2, 3 4),(5 6, 7 8))")
                .unwrap()
                .len(),
            4
        );
        assert_eq!(
            parse_points("1.5,2 3,4,9", ' ').unwrap(),
            [(1.5, 2.0), (3.0, 4.0)]
        );
        for bad in ["POINT (1 2)", "LINESTRING (1 2)", "LINESTRING (a b, c d)", ""] {
            assert_eq!(parse_wkt(bad), None);
        }
    }
}
