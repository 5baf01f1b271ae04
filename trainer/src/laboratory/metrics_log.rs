//! Metrics of all episodes: CSV and TensorBoard files that grow while the run does, and a Parquet file at its end.
//!
//! The growing files have one record for each episode behind one that begins them. A run that goes on from a checkpoint cuts
//! them back to the checkpoint's episodes; the times in the event file are all that then differs from an undisturbed run.

use super::learner::Metrics;
use super::tensorboard;
use host_sim::report::table::{Column, Table};
use kit::error::{Error, Result};
use kit::files::write_whole;
use serde_json::Value;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The column of episodes, from 1.
const EPISODE: &str = "episode";

/// Metrics of the episodes so far.
pub struct MetricsLog {
    csv: PathBuf,
    events: PathBuf,
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
    /// Rows that the files already have.
    written: usize,
}

impl MetricsLog {
    /// A log of `done` episodes: the first ones of the files, which are cut back to them. Without episodes there need be no
    /// files.
    ///
    /// # Errors
    /// If the files have fewer episodes, or are no such files.
    pub fn open(csv: &Path, events: &Path, done: u64) -> Result<Self> {
        let mut log = Self {
            csv: csv.to_owned(),
            events: events.to_owned(),
            names: Vec::new(),
            rows: Vec::new(),
            written: 0,
        };
        if done == 0 {
            remove(csv)?;
            remove(events)?;
            return Ok(log);
        }
        let text = std::fs::read(csv).map_err(|source| Error::file(csv, source))?;
        let text = String::from_utf8(text)
            .map_err(|_| Error::input(csv.display(), "bytes that are no text", "metrics"))?;
        let mut length = 0;
        for (index, line) in text.split_inclusive('\n').take(done as usize + 1).enumerate() {
            let place = || format!("{}:{}", csv.display(), index + 1);
            let fields = line.strip_suffix('\n').map(|line| line.split(','));
            let Some(mut fields) = fields else { break };
            let first = fields.next();
            if index == 0 {
                if first != Some(EPISODE) {
                    return Err(Error::input(place(), "another header", "that of metrics"));
                }
                log.names = fields.map(str::to_owned).collect();
            } else {
                let row: Option<Vec<f64>> = fields.map(read_number).collect();
                let row = row
                    .filter(|row| row.len() == log.names.len() && first == Some(index.to_string().as_str()));
                log.rows.push(
                    row.ok_or_else(|| Error::input(place(), "another line", format!("episode {index}")))?,
                );
            }
            length += line.len();
        }
        if log.rows.len() as u64 != done {
            let found = format!("{} episodes", log.rows.len());
            return Err(Error::input(
                csv.display(),
                found,
                format!("{done} as in the checkpoint"),
            ));
        }
        cut(csv, length as u64)?;
        let bytes = std::fs::read(events).map_err(|source| Error::file(events, source))?;
        let length = tensorboard::length_of(&bytes, done + 1).ok_or_else(|| {
            Error::input(
                events.display(),
                "fewer whole records",
                format!("{done} as in the checkpoint"),
            )
        })?;
        cut(events, length)?;
        log.written = log.rows.len();
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

    /// Appends the new episodes to the files.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        if self.written == self.rows.len() {
            return Ok(());
        }
        // Only for TensorBoard's axis of time; nothing is computed from it.
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let wall_time_s = now.map_or(0.0, |since| since.as_secs_f64());
        let (mut text, mut events) = (String::new(), Vec::new());
        if self.written == 0 {
            let header = std::iter::once(EPISODE).chain(self.names.iter().map(String::as_str));
            text = header.collect::<Vec<_>>().join(",") + "\n";
            events = tensorboard::header(wall_time_s);
        }
        for (index, row) in self.rows.iter().enumerate().skip(self.written) {
            let episode = index + 1;
            text += &episode.to_string();
            for value in row {
                text.push(',');
                if !value.is_nan() {
                    text += &value.to_string();
                }
            }
            text.push('\n');
            let known = self.names.iter().map(String::as_str).zip(row.iter().copied());
            let known = known.filter(|(_, value)| !value.is_nan());
            events.extend(tensorboard::scalars(wall_time_s, episode as u64, known));
        }
        append(&self.csv, text.as_bytes())?;
        append(&self.events, &events)?;
        self.written = self.rows.len();
        Ok(())
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
    file.and_then(|mut file| file.write_all(bytes))
        .map_err(|source| Error::file(path, source))
}

fn cut(path: &Path, length: u64) -> Result<()> {
    let file = File::options().write(true).open(path);
    file.and_then(|file| file.set_len(length))
        .map_err(|source| Error::file(path, source))
}

fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => Err(Error::file(path, source)),
        _ => Ok(()),
    }
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
    fn a_log_that_is_cut_back_grows_to_the_same_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (csv, events, parquet) = (path("m.csv"), path("events"), path("m.parquet"));
        let run = |from: u64, to: u64| {
            let mut log = MetricsLog::open(&csv, &events, from)?;
            for episode in from + 1..=to {
                log.push(&metrics(episode as u32))?;
                if episode % 2 == 0 {
                    log.flush()?;
                }
            }
            log.flush()?;
            log.write_parquet(&parquet)?;
            let events = std::fs::read(&events).unwrap();
            Ok::<_, Error>((
                std::fs::read_to_string(&csv).unwrap(),
                events.len(),
                std::fs::read(&parquet).unwrap(),
            ))
        };
        let undisturbed = run(0, 9).unwrap();
        assert!(
            undisturbed
                .0
                .starts_with("episode,mean_age_ms,loss\n1,0.1,\n2,0.2,\n3,")
        );
        assert_eq!(run(4, 9).unwrap(), undisturbed);
        // A kill in the middle of a line.
        cut(&csv, undisturbed.0.len() as u64 - 3).unwrap();
        assert_eq!(run(8, 9).unwrap(), undisturbed);
        let message = run(10, 11).unwrap_err().to_string();
        assert!(
            message.ends_with("found 9 episodes, expected 10 as in the checkpoint"),
            "{message}"
        );
    }
}
