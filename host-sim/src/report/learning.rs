//! The paper's two learning figures: average reward and average age over episodes.

use super::chart::{Axis, LineChart, Point, Series};
use super::table::{Column, Table};
use kit::error::{Error, Result};
use kit::files::NamedText;

/// Curves of runs that come with the program. `trainer/studies/paper_form.toml` says which, and the command that makes
/// them again.
const SHIPPED: &str = include_str!("../../data/learning.csv");

/// Columns of the file.
const HEADER: [&str; 8] = [
    "case",
    "episode",
    "mean_reward",
    "least_reward",
    "largest_reward",
    "mean_age_ms",
    "least_age_ms",
    "largest_age_ms",
];

/// A point of a case's curves.
#[derive(Clone, Debug, PartialEq)]
pub struct CurvePoint {
    /// Which.
    pub case: String,
    /// Last of the episodes that the point is the mean of.
    pub episode: u64,
    /// Interquartile mean, least and largest of the seeds' mean global reward of a slot.
    pub reward: [f64; 3],
    /// The same for the mean age while exploring.
    pub age_ms: [f64; 3],
}

/// Points as the text of a file.
///
/// # Errors
/// Never: its columns have a row for each point.
pub fn curves_csv(points: &[CurvePoint]) -> Result<String> {
    let number = |column: usize, value: fn(&CurvePoint) -> f64| {
        Column::number(HEADER[column], points.iter().map(value))
    };
    let table = Table::new(vec![
        Column::text(HEADER[0], points.iter().map(|point| point.case.clone())),
        Column::unsigned(HEADER[1], points.iter().map(|point| point.episode)),
        number(2, |point| point.reward[0]),
        number(3, |point| point.reward[1]),
        number(4, |point| point.reward[2]),
        number(5, |point| point.age_ms[0]),
        number(6, |point| point.age_ms[1]),
        number(7, |point| point.age_ms[2]),
    ])?;
    Ok(table.to_csv())
}

/// Reads such a file's text.
///
/// # Errors
/// [`Error::Input`] names the line.
pub fn read_curves(place: &str, text: &str) -> Result<Vec<CurvePoint>> {
    let mut reader = csv::ReaderBuilder::new().from_reader(text.as_bytes());
    let header = reader
        .headers()
        .map_err(|error| Error::input(place, error, "learning curves"))?;
    if header.iter().ne(HEADER) {
        let found = header.iter().collect::<Vec<_>>().join(",");
        return Err(Error::input(format!("{place}:1"), found, HEADER.join(",")));
    }
    let rows = reader.records().zip(2..).map(|(record, line)| {
        let place = format!("{place}:{line}");
        let record = record.map_err(|error| Error::input(&place, error, "eight fields"))?;
        let number = |index: usize| -> Result<f64> {
            let number = record[index]
                .parse()
                .ok()
                .filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| Error::input(&place, &record[index], "a number"))
        };
        let episode = record[1]
            .parse()
            .map_err(|_| Error::input(&place, &record[1], "an episode"))?;
        Ok(CurvePoint {
            case: record[0].to_owned(),
            episode,
            reward: [number(2)?, number(3)?, number(4)?],
            age_ms: [number(5)?, number(6)?, number(7)?],
        })
    });
    rows.collect()
}

/// The shipped curves as figures and data.
///
/// # Errors
/// Never for the shipped file.
pub fn paper_figures() -> Result<Vec<NamedText>> {
    let points = read_curves("learning.csv", SHIPPED)?;
    let note = "Interquartile mean over seeds, which of three is their mean, band from the least to the largest seed; while exploring, in \
                episodes of 100 slots that mostly begin with unknown ages; each point averages a hundredth of the episodes. Rewards are \
                each preset's own: minus age over the number of vehicles in the paper's form, over ten in \"freshlane\".";
    let chart = |title: &str, vertical, value: fn(&CurvePoint) -> [f64; 3]| LineChart {
        title: title.to_owned(),
        note: note.to_owned(),
        horizontal: Axis::logarithmic("episode"),
        vertical,
        series: series(&points, value),
        references: Vec::new(),
    };
    let reward = chart(
        "Average reward over learning episodes",
        Axis::linear("mean global reward of a slot"),
        |point| point.reward,
    );
    let age = chart(
        "Average age of information over learning episodes",
        Axis::logarithmic("mean age of information (ms)"),
        |point| point.age_ms,
    );
    Ok(vec![
        ("learning_reward.svg".to_owned(), reward.to_svg()?),
        ("learning_age.svg".to_owned(), age.to_svg()?),
        ("learning.csv".to_owned(), SHIPPED.to_owned()),
    ])
}

/// One series a case, in the order of the file.
fn series(points: &[CurvePoint], value: fn(&CurvePoint) -> [f64; 3]) -> Vec<Series> {
    let mut series: Vec<Series> = Vec::new();
    for point in points {
        let [mean, least, largest] = value(point);
        let drawn = Point {
            x: point.episode as f64,
            y: mean,
            band: Some((least, largest)),
        };
        match series.last_mut() {
            Some(last) if last.name == point.case => last.points.push(drawn),
            _ => series.push(Series {
                name: point.case.clone(),
                points: vec![drawn],
            }),
        }
    }
    series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_survive_a_file_and_bad_ones_name_their_line() {
        let point = CurvePoint {
            case: "paper, as printed".to_owned(),
            episode: 7,
            reward: [-0.5, -0.75, -0.25],
            age_ms: [40.0, 30.0, 50.5],
        };
        let text = curves_csv(std::slice::from_ref(&point)).unwrap();
        assert_eq!(read_curves("file", &text).unwrap(), [point]);
        let message = |text: &str| read_curves("file", text).unwrap_err().to_string();
        assert!(message("a,b\n").starts_with("file:1: found a,b, expected case,episode,"));
        assert_eq!(
            message(&text.replace("50.5", "NaN")),
            "file:2: found NaN, expected a number"
        );
    }

    #[test]
    fn the_shipped_curves_are_drawn() {
        let files = paper_figures().unwrap();
        let cases = series(&read_curves("shipped", SHIPPED).unwrap(), |point| point.age_ms);
        assert!(!cases.is_empty());
        for (_, text) in &files[..2] {
            for case in &cases {
                assert!(
                    text.contains(&case.name.split(',').next().unwrap().to_owned()),
                    "{}",
                    case.name
                );
            }
        }
    }
}
