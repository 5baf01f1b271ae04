//! Studies: one plan of cases and seeds, every run trained and evaluated alike.
//!
//! Runs live in folders of their own and go on where they were interrupted; a finished one is not done again.

use crate::configuration::{Configuration, ConfigurationSource, Preset};
use crate::evaluate::{exploring, float, quantised};
use crate::run_folder::{GoOn, RunFolder, RunIdentity};
use crate::trained_actors::TrainedActors;
use crate::training::{Conduct, train};
use firmware::table::Table;
use host_sim::age::AgeSummary;
use host_sim::mobility::Grid;
use host_sim::scenario::Scenario;
use host_sim::simulation::{Extent, Simulation};
use host_sim::weight_table::WeightTable;
use host_sim::{Shard, thread_pool};
use kit::error::{Error, Result};
use kit::files::{Text, check_folder, write_whole};
use kit::layers::parse_as;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// A plan file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Plan {
    /// Preset of all cases.
    pub preset: Preset,
    /// `KEY=VALUE` settings of all cases.
    #[serde(default)]
    pub set: Vec<String>,
    /// Seeds of the runs of each case.
    pub seeds: Vec<u64>,
    /// How each run is evaluated.
    pub evaluation: Evaluation,
    /// What is compared.
    pub case: Vec<Case>,
}

/// Held-out worlds of a study, the same for every run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Evaluation {
    /// Seed of the worlds.
    pub seed: u64,
    /// Independent worlds.
    pub worlds: u32,
    /// Slots that count.
    pub slots: u32,
    /// Slots before.
    pub warmup: u32,
}

/// One row of the comparison.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Case {
    /// What the tables call it.
    pub name: String,
    /// Another preset than the plan's.
    pub preset: Option<Preset>,
    /// `KEY=VALUE` settings over the plan's.
    #[serde(default)]
    pub set: Vec<String>,
}

/// Mean age of one form of a run's actors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FormResult {
    /// In which cell, where the run is of a mixture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<String>,
    /// `actor` (int8), `float` (greedy) or `exploring`.
    pub form: String,
    /// Over vehicles, slots and worlds.
    pub mean_age_ms: f64,
    /// Half of the 95 % interval over worlds, if there are several.
    pub mean_age_ci95_ms: Option<f64>,
    /// Of the median world.
    pub median_world_age_ms: f64,
}

/// One run of a study.
#[derive(Clone, Debug)]
pub struct StudyRun {
    /// Index of its case.
    pub case: usize,
    /// Its seed.
    pub seed: u64,
    /// Where it is.
    pub folder: PathBuf,
    /// What came out.
    pub forms: Vec<FormResult>,
}

/// How a study is carried out; none of it changes a run's result.
#[derive(Clone, Copy, Debug)]
pub struct StudyConduct {
    /// Which of its runs.
    pub shard: Shard,
    /// Runs at once.
    pub parallel: usize,
    /// Threads of each.
    pub threads: u16,
    /// Say nothing.
    pub quiet: bool,
}

impl Plan {
    /// Reads and checks a plan and every configuration in it.
    ///
    /// # Errors
    /// The file and the line, the case or the setting.
    pub fn read(path: &Path) -> Result<Self> {
        let Text { name: place, text } = Text::read(path)?;
        let plan: Self = parse_as(&place, &text, "a plan")?;
        if plan.seeds.is_empty() || plan.case.is_empty() {
            return Err(Error::input(place, "no seed or no case", "at least one of each"));
        }
        for (index, seed) in plan.seeds.iter().enumerate() {
            if plan.seeds[..index].contains(seed) {
                let found = format!("{seed} twice");
                return Err(Error::input(format!("{place}: seeds"), found, "each seed once"));
            }
        }
        for (key, number) in [
            ("worlds", plan.evaluation.worlds),
            ("slots", plan.evaluation.slots),
        ] {
            if number == 0 {
                let key = format!("{place}: evaluation.{key}");
                return Err(Error::input(key, number, "1 or more"));
            }
        }
        for (index, case) in plan.case.iter().enumerate() {
            let folder = folder_name(&case.name);
            if folder.is_empty() {
                let found = format!("`{}`", case.name);
                return Err(Error::input(
                    format!("{place}: case"),
                    found,
                    "a name with a letter or a digit",
                ));
            }
            if plan.case[..index]
                .iter()
                .any(|other| folder_name(&other.name) == folder)
            {
                return Err(Error::input(
                    format!("{place}: case {}", case.name),
                    "a name twice",
                    "names that differ in a letter or digit",
                ));
            }
            let _configuration = plan
                .configuration(case)
                .map_err(|error| error.within(format!("{place}: case {}", case.name)))?;
        }
        Ok(plan)
    }

    fn configuration(&self, case: &Case) -> Result<Configuration> {
        ConfigurationSource {
            preset: case.preset.unwrap_or(self.preset),
            file: None,
            settings: self.set.iter().chain(&case.set).cloned().collect(),
        }
        .read()
    }

    /// The case, by its index, and the seed of every run, in the order of the tables: shards count them in it.
    fn runs(&self) -> Vec<(usize, u64)> {
        (0..self.case.len())
            .flat_map(|case| self.seeds.iter().map(move |&seed| (case, seed)))
            .collect()
    }

    /// Trains and evaluates the runs of a shard under a folder; the results come in the order of cases, then seeds.
    ///
    /// # Errors
    /// The first run that fails.
    pub fn carry_out(&self, out: &Path, conduct: &StudyConduct) -> Result<Vec<StudyRun>> {
        check_folder(out)?;
        RunFolder::new(out).check_no_run()?;
        let all = self.runs();
        let runs: Vec<(usize, u64)> = conduct.shard.of(all.len()).map(|run| all[run]).collect();
        let next = AtomicUsize::new(0);
        let results = Mutex::new(Vec::new());
        let work = || -> Result<()> {
            let pool = thread_pool(Some(conduct.threads))?;
            while let Some(&(case, seed)) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
                let run = pool.install(|| self.carry_out_one(out, case, seed))?;
                if !conduct.quiet {
                    for cell in run.cells() {
                        let greedy = run.greedy(cell).map_or(f64::NAN, |form| form.mean_age_ms);
                        let name = in_cell(&self.case[case].name, cell);
                        kit::remark!("{name}, seed {seed}: {greedy:.3} ms");
                    }
                }
                if let Ok(mut results) = results.lock() {
                    results.push(run);
                }
            }
            Ok(())
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..conduct.parallel.max(1)).map(|_| scope.spawn(work)).collect();
            workers.into_iter().try_for_each(|worker| match worker.join() {
                Ok(outcome) => outcome,
                Err(panic) => std::panic::resume_unwind(panic),
            })
        })?;
        let mut results = results.into_inner().unwrap_or_default();
        results
            .sort_by_key(|run: &StudyRun| (run.case, self.seeds.iter().position(|&seed| seed == run.seed)));
        Ok(results)
    }

    /// Case, by its index, and seed of the runs that are not finished under a folder.
    ///
    /// # Errors
    /// Never, for a plan that was checked.
    pub fn missing(&self, out: &Path) -> Result<Vec<(usize, u64)>> {
        let mut missing = Vec::new();
        for (case, seed) in self.runs() {
            if self.place(out, case, seed)?.finished().is_none() {
                missing.push((case, seed));
            }
        }
        Ok(missing)
    }

    fn carry_out_one(&self, out: &Path, case: usize, seed: u64) -> Result<StudyRun> {
        let place = self.place(out, case, seed)?;
        let conduct = Conduct {
            go_on: GoOn::Same,
            checkpoint_every: Duration::from_secs(30),
        };
        let forms = match place.finished() {
            Some(forms) => forms,
            None => {
                let _report = train(&place.identity, &place.path, &conduct, |_| ())?;
                let trained = TrainedActors::read(&RunFolder::new(&place.path))?;
                let forms = self.evaluation.forms(&place.identity, &trained)?;
                let object = json!({ "stamp": place.stamp, "forms": forms });
                write_whole(&place.evaluation(), format!("{object:#}\n").as_bytes())?;
                forms
            }
        };
        Ok(StudyRun {
            case,
            seed,
            folder: place.path,
            forms,
        })
    }

    fn place(&self, out: &Path, case: usize, seed: u64) -> Result<RunPlace> {
        let case = &self.case[case];
        let folder = out.join("runs").join(folder_name(&case.name));
        let identity = RunIdentity::new(seed, self.configuration(case)?);
        Ok(RunPlace {
            path: folder.join(seed.to_string()),
            stamp: json!({ "run": identity.to_json(), "evaluation": self.evaluation }),
            identity,
        })
    }
}

/// Where a run of a study lies, and what it is.
struct RunPlace {
    path: PathBuf,
    identity: RunIdentity,
    /// What its evaluation depends on.
    stamp: Value,
}

impl RunPlace {
    fn evaluation(&self) -> PathBuf {
        self.path.join("evaluation.json")
    }

    /// What came out, if the run is trained and was evaluated on the same worlds.
    fn finished(&self) -> Option<Vec<FormResult>> {
        let forms = read_evaluation(&self.evaluation(), &self.stamp)?;
        let folder = RunFolder::new(&self.path);
        // One that went on for more episodes is another.
        let this = folder.read_identity().ok()? == Some(self.identity.clone());
        (this && folder.report().exists()).then_some(forms)
    }
}

/// What an earlier evaluation of the same run on the same worlds found.
fn read_evaluation(path: &Path, stamp: &Value) -> Option<Vec<FormResult>> {
    let bytes = std::fs::read(path).ok()?;
    let mut object: Value = serde_json::from_slice(&bytes).ok()?;
    let forms = object["forms"].take();
    (object["stamp"] == *stamp).then(|| serde_json::from_value(forms).ok())?
}

impl Evaluation {
    /// All forms, in each cell of a mixture.
    fn forms(&self, identity: &RunIdentity, trained: &TrainedActors) -> Result<Vec<FormResult>> {
        let configuration = &identity.configuration;
        if configuration.mixture.is_empty() {
            return self.forms_in(None, &configuration.scenario, trained);
        }
        let cells = configuration.mixture.iter();
        let each = cells.map(|cell| self.forms_in(Some(&cell.name), &cell.scenario, trained));
        Ok(each.collect::<Result<Vec<_>>>()?.concat())
    }

    fn forms_in(
        &self,
        cell: Option<&str>,
        scenario: &Scenario,
        trained: &TrainedActors,
    ) -> Result<Vec<FormResult>> {
        let simulation = Simulation {
            scenario,
            source: &Grid,
            extent: Extent {
                seed: self.seed,
                worlds: self.worlds,
                slots: self.slots,
                warmup: self.warmup,
            },
        };
        let tables: Result<Vec<Table<'_>>> = trained.tables.iter().map(WeightTable::parse).collect();
        let tables = tables?;
        let mut forms = Vec::new();
        let mut add = |form: &str, ages: AgeSummary| {
            forms.push(FormResult {
                cell: cell.map(str::to_owned),
                form: form.to_owned(),
                mean_age_ms: ages.mean_ms,
                mean_age_ci95_ms: ages.ci95_ms,
                median_world_age_ms: ages.median_world_ms,
            });
        };
        if !tables.is_empty() {
            add("actor", quantised(&simulation, &tables, || ())?);
        }
        add(
            "float",
            float(&simulation, &trained.actors, trained.setting, &[], || ())?.0,
        );
        add(
            "exploring",
            exploring(&simulation, &trained.actors, trained.setting, || ())?,
        );
        Ok(forms)
    }
}

impl StudyRun {
    /// The cells of its mixture; without one, the scenario, which has no name.
    pub fn cells(&self) -> Vec<Option<&str>> {
        let mut cells: Vec<_> = self.forms.iter().map(|form| form.cell.as_deref()).collect();
        cells.dedup();
        cells
    }

    /// The form of this name in a cell.
    pub fn form(&self, cell: Option<&str>, name: &str) -> Option<&FormResult> {
        let is_it = |result: &&FormResult| result.form == name && result.cell.as_deref() == cell;
        self.forms.iter().find(is_it)
    }

    /// The deployed form: int8 where there is one, else the greedy float networks.
    pub fn greedy(&self, cell: Option<&str>) -> Option<&FormResult> {
        self.form(cell, "actor").or_else(|| self.form(cell, "float"))
    }
}

/// A case in a cell, for people.
pub(crate) fn in_cell(case: &str, cell: Option<&str>) -> String {
    cell.map_or_else(|| case.to_owned(), |cell| format!("{case}, {cell}"))
}

/// A case's name with only letters, digits and hyphens.
fn folder_name(name: &str) -> String {
    let words: Vec<String> = name
        .split(|character: char| !character.is_ascii_alphanumeric())
        .filter(|word| !word.is_empty())
        .map(str::to_lowercase)
        .collect();
    words.join("-")
}
