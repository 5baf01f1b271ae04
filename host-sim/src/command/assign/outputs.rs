//! The files that `assign` writes beside its report.

use super::{AssignArguments, flow_files};
use crate::assign::Assignment;
use assignment::{Algorithm, Network, Solution, convergence, gmns, path_flows, select_link, skims};
use kit::error::{Error, Result};
use kit::files::{check_output, write_set, write_whole};
use std::path::{Path, PathBuf};

/// Refuses combinations of options that ask for what does not exist, before anything is solved.
pub(super) fn check_options(arguments: &AssignArguments) -> Result<()> {
    for (name, path) in named_files(arguments) {
        if arguments.check.is_some() && path.is_some() {
            let expected = "one of the two: --check solves nothing";
            return Err(Error::input(name, "--check beside it", expected));
        }
    }
    // Path flows may take the place of those that they started from; nothing may take that of a network or its demand.
    let mut inputs = vec![PathBuf::from(&arguments.net)];
    inputs.extend(arguments.trips.clone());
    for (name, path) in named_files(arguments) {
        if let Some(path) = path {
            check_output(name, path, &inputs)?;
        }
    }
    if arguments.selected.is_some() == arguments.select_link.is_empty() {
        let (name, missing) = if arguments.selected.is_some() {
            ("--selected", "no --select-link")
        } else {
            ("--select-link", "no --selected")
        };
        let expected = "both: the links, and the file for their trips";
        return Err(Error::input(name, missing, expected));
    }
    let needs_paths = [
        ("--warm", arguments.warm.is_some()),
        ("--paths", arguments.paths.is_some()),
        ("--selected", arguments.selected.is_some()),
    ];
    if arguments.algorithm != Algorithm::PathBased
        && let Some((name, _)) = needs_paths.into_iter().find(|(_, asked)| *asked)
    {
        let expected = "`--algorithm path`: the Frank-Wolfe family knows no paths";
        return Err(Error::input(name, "another algorithm", expected));
    }
    Ok(())
}

/// Every file that a solve can read or write, with its option.
fn named_files(arguments: &AssignArguments) -> [(&'static str, &Option<PathBuf>); 7] {
    [
        ("--flows", &arguments.flows),
        ("--paths", &arguments.paths),
        ("--skims", &arguments.skims),
        ("--selected", &arguments.selected),
        ("--convergence", &arguments.convergence),
        ("--gmns", &arguments.gmns),
        ("--warm", &arguments.warm),
    ]
}

/// The links of every `--select-link`, so that an unknown one is an error before the solve.
pub(super) struct Selection<'a> {
    links: Vec<(&'a str, &'a str, Vec<u32>)>,
}

impl<'a> Selection<'a> {
    pub(super) fn new(arguments: &'a AssignArguments, network: &Network) -> Result<Self> {
        let mut links = Vec::new();
        for text in &arguments.select_link {
            let Some((from, to)) = text.split_once(',') else {
                let found = format!("`{text}`");
                return Err(Error::input(
                    "--select-link",
                    found,
                    "two nodes with a comma between them",
                ));
            };
            let (from, to) = (from.trim(), to.trim());
            let between = select_link::links_between(network, "--select-link", from, to)?;
            links.push((from, to, between));
        }
        Ok(Self { links })
    }

    fn format(&self, network: &Network, solution: &Solution) -> String {
        let mut text = format!("{}\n", select_link::HEADER);
        for (from, to, links) in &self.links {
            let selected = select_link::select_links(&solution.path_flows, links);
            text.push_str(&select_link::format_rows(network, from, to, &selected));
        }
        text
    }
}

/// Writes every file that was asked for; all texts are made before the first is written.
pub(super) fn write(
    arguments: &AssignArguments,
    assignment: &Assignment,
    selection: &Selection<'_>,
    solution: &Solution,
) -> Result<()> {
    let Assignment { network, demand, .. } = assignment;
    let mut files: Vec<(&Path, Vec<u8>)> = Vec::new();
    let costs = &solution.link_costs;
    if let Some(path) = &arguments.flows {
        files.push((
            path,
            flow_files::encode(path, network, &solution.link_flows, costs)?,
        ));
    }
    if let Some(path) = &arguments.paths {
        let text = path_flows::format_paths(network, &solution.path_flows, costs);
        files.push((path, text.into_bytes()));
    }
    if let Some(path) = &arguments.skims {
        let skims = skims::skims(network, costs)?;
        files.push((path, skims::format_skims(network, &skims).into_bytes()));
    }
    if let Some(path) = &arguments.selected {
        files.push((path, selection.format(network, solution).into_bytes()));
    }
    if let Some(path) = &arguments.convergence {
        let text = convergence::format_convergence(&solution.convergence);
        files.push((path, text.into_bytes()));
    }
    for (path, bytes) in files {
        write_whole(path, &bytes)?;
    }
    if let Some(folder) = &arguments.gmns {
        let mut set = gmns::format_network(network, &gmns::Extras::default());
        set.push(("demand.csv".to_owned(), gmns::format_demand(network, demand)));
        write_set(folder, &set)?;
    }
    Ok(())
}

/// What was written, with a word for each, in the order of the options.
pub(super) fn written(arguments: &AssignArguments) -> impl Iterator<Item = (&'static str, &Path)> {
    let words = [
        "link flows",
        "path flows",
        "skims",
        "select link",
        "convergence",
        "GMNS",
    ];
    let files = words.into_iter().zip(named_files(arguments));
    files.filter_map(|(word, (_, path))| path.as_deref().map(|path| (word, path)))
}
