//! Metrics of all episodes: CSV and TensorBoard files that grow while the run does, and a Parquet file at its end.
//!
//! A checkpoint holds the CSV's text, so that a run goes on whatever became of the files: both are written anew. The event file's times
//! are episodes, so that it is the same file whenever the run was at work.

use super::learner::{Metrics, name};
use super::tensorboard;
use host_sim::report::table::{Column, Table};
use kit::error::{Error, Result};
use kit::files::{remove, write_whole};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The column of episodes, from 1.
const EPISODE: &str = "episode";

/// Metrics of the episodes so far.
pub struct MetricsLog {
    csv: PathBuf,
    events: PathBuf,
    /// What the run was told, for the event file.
    told: BTreeMap<String, Value>,
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
    /// Rows that the event file already has.
    written: usize,
}

impl MetricsLog {
    /// A log without episodes of a run that was told this; files of an earlier one go.
    ///
    /// # Errors
    /// If they cannot be removed.
    pub fn new(csv: &Path, events: &Path, told: BTreeMap<String, Value>) -> Result<Self> {
        remove(csv)?;
        remove(events)?;
        Ok(Self {
            csv: csv.to_owned(),
            events: events.to_owned(),
            told,
            names: Vec::new(),
            rows: Vec::new(),
            written: 0,
        })
    }

    /// The log whose [text](Self::text) this is, and its files.
    ///
    /// # Errors
    /// If it is no such text, which `place` names then, or the files cannot be written.
    pub fn resume(
        place: &str,
        text: &str,
        csv: &Path,
        events: &Path,
        told: BTreeMap<String, Value>,
    ) -> Result<Self> {
        let mut lines = text.lines();
        let mut names = lines.next().unwrap_or_default().split(',');
        if names.next() != Some(EPISODE) {
            return Err(Error::input(place, "another header", "that of metrics"));
        }
        let names = names.map(str::to_owned).collect();
        let mut log = Self {
            names,
            ..Self::new(csv, events, told)?
        };
        for (index, line) in lines.enumerate() {
            let row: Option<Vec<f64>> = line.split(',').skip(1).map(read_number).collect();
            let row = row.filter(|row| row.len() == log.names.len());
            let expected = || format!("the metrics of episode {}", index + 1);
            log.rows
                .push(row.ok_or_else(|| Error::input(place, line, expected()))?);
        }
        log.flush()?;
        Ok(log)
    }

    /// Adds an episode.
    ///
    /// # Errors
    /// If its metrics have other names than the ones before.
    pub fn push(&mut self, metrics: &Metrics) -> Result<()> {
        let names: Vec<&str> = metrics.iter().map(|(name, _)| name).collect();
        if self.rows.is_empty() {
            self.names = names.into_iter().map(str::to_owned).collect();
        } else if self.names != names {
            let expected = format!("{:?} as before", self.names);
            return Err(Error::input("metrics", format!("{names:?}"), expected));
        }
        self.rows.push(metrics.iter().map(|(_, value)| value).collect());
        Ok(())
    }

    /// All episodes as CSV.
    pub fn text(&self) -> String {
        let header = std::iter::once(EPISODE).chain(self.names.iter().map(String::as_str));
        let mut text = header.collect::<Vec<_>>().join(",") + "\n";
        for (index, row) in self.rows.iter().enumerate() {
            text += &(index + 1).to_string();
            for value in row {
                text.push(',');
                if !value.is_nan() {
                    text += &value.to_string();
                }
            }
            text.push('\n');
        }
        text
    }

    /// Brings the files up to the last episode.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        let mut events = Vec::new();
        if self.written == 0 {
            events = tensorboard::header(&self.told, &[name::AGE, name::REWARD]);
        }
        for (index, row) in self.rows.iter().enumerate().skip(self.written) {
            let known = self.names.iter().map(String::as_str).zip(row.iter().copied());
            let known = known.filter(|(_, value)| !value.is_nan());
            events.extend(tensorboard::scalars(index as u64 + 1, known));
        }
        append(&self.events, &events)?;
        self.written = self.rows.len();
        write_whole(&self.csv, self.text().as_bytes())
    }

    /// Numbers of the last episode, as JSON; one that it does not have is null.
    pub fn last(&self) -> impl Iterator<Item = (String, Value)> {
        let row = self.rows.last().into_iter().flatten();
        self.names
            .iter()
            .cloned()
            .zip(row.map(|&value| Value::from(value)))
    }

    /// Writes all episodes as Parquet.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_parquet(&self, path: &Path) -> Result<()> {
        let episodes = Column::unsigned(EPISODE, 1..=self.rows.len() as u64);
        let values = self.names.iter().enumerate().map(|(index, name)| {
            let values = self
                .rows
                .iter()
                .map(move |row| Some(row[index]).filter(|value| !value.is_nan()));
            Column::number(name, values)
        });
        let table = Table::new(std::iter::once(episodes).chain(values).collect())?;
        write_whole(path, &table.to_parquet()?)
    }
}

/// An empty field is a missing number.
fn read_number(field: &str) -> Option<f64> {
    if field.is_empty() {
        Some(f64::NAN)
    } else {
        field.parse().ok()
    }
}

fn append(path: &Path, bytes: &[u8]) -> Result<()> {
    let file = OpenOptions::new().append(true).create(true).open(path);
    file.and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .map_err(|source| Error::file(path, source))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics(episode: u32) -> Metrics {
        let loss = if episode < 3 {
            f64::NAN
        } else {
            1.0 / f64::from(episode)
        };
        Metrics::default()
            .with("mean_age_ms", f64::from(episode) * 0.1)
            .with("loss", loss)
    }

    #[test]
    fn a_log_that_goes_on_grows_to_the_same_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (csv, events, parquet) = (path("m.csv"), path("events"), path("m.parquet"));
        let run = |mut log: MetricsLog, to: u32| {
            let from = log.rows.len() as u32;
            for episode in from + 1..=to {
                log.push(&metrics(episode)).unwrap();
                if episode % 2 == 0 {
                    log.flush().unwrap();
                }
            }
            log.flush().unwrap();
            log.write_parquet(&parquet).unwrap();
            let read = |path: &Path| std::fs::read(path).unwrap();
            (log.text(), read(&events), read(&parquet))
        };
        let told = || BTreeMap::from([("seed".to_owned(), Value::from(1))]);
        let undisturbed = run(MetricsLog::new(&csv, &events, told()).unwrap(), 9);
        let (text, ..) = &undisturbed;
        assert!(text.starts_with("episode,mean_age_ms,loss\n1,0.1,\n2,0.2,\n3,"));
        assert_eq!(&std::fs::read_to_string(&csv).unwrap(), text);
        let four: String = text.split_inclusive('\n').take(5).collect();
        let resume = || MetricsLog::resume("checkpoint", &four, &csv, &events, told()).unwrap();
        assert_eq!(run(resume(), 9), undisturbed);
        // Whatever became of the files.
        std::fs::write(&csv, "nonsense").unwrap();
        remove(&events).unwrap();
        assert_eq!(run(resume(), 9), undisturbed);
    }
}
