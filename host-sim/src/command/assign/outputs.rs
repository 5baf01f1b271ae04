//! The files that `assign` writes beside its report.

use super::{AssignArguments, flow_files, page};
use crate::assign::{Assignment, vehicle_classes};
use crate::command::options::typed;
use assignment::link_table::Delay;
use assignment::report::ImportReport;
use assignment::{
    Algorithm, ClassSolution, Network, PathFlows, convergence, formats, geojson, gmns, path_flows,
    select_link, skims,
};
use kit::error::{Error, Result};
use kit::files::{Text, check_output, write_set, write_whole};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// A file or folder that a solve writes.
struct Output<'a> {
    option: &'static str,
    /// What it holds, in two words.
    word: &'static str,
    path: &'a Option<PathBuf>,
    /// How its name may end; any way where there is none.
    endings: &'static [&'static str],
}

/// How names of flows and of skims may end: the libraries behind the second kind are features.
const FLOW_ENDINGS: &[&str] = if cfg!(feature = "parquet") {
    &["csv", "parquet"]
} else {
    &["csv"]
};
const SKIM_ENDINGS: &[&str] = if cfg!(feature = "omx") {
    &["csv", "omx"]
} else {
    &["csv"]
};

/// Every file that a solve can write, in the order of reports.
fn outputs(arguments: &AssignArguments) -> [Output<'_>; 8] {
    let output = |option, word, path, endings| Output {
        option,
        word,
        path,
        endings,
    };
    [
        output("--flows", "link flows", &arguments.flows, FLOW_ENDINGS),
        output("--paths", "path flows", &arguments.paths, &["csv"]),
        output("--skims", "skims", &arguments.skims, SKIM_ENDINGS),
        output("--selected", "select link", &arguments.selected, &["csv"]),
        output("--convergence", "convergence", &arguments.convergence, &["csv"]),
        output(
            "--geojson",
            "roads with flows",
            &arguments.geojson,
            &["geojson", "json"],
        ),
        output("--report", "report", &arguments.report, &["html"]),
        output("--gmns", "GMNS", &arguments.gmns, &[]),
    ]
}

/// Refuses combinations of options that ask for what does not exist, before anything is solved.
pub(super) fn check_options(arguments: &AssignArguments) -> Result<()> {
    let beyond = [
        ("--classes", arguments.classes.is_some()),
        ("--link-table", arguments.link_table.is_some()),
        ("--delay", arguments.delay != Delay::Bpr),
    ];
    if arguments.gmns.is_some()
        && let Some((name, _)) = beyond.into_iter().find(|(_, given)| *given)
    {
        let expected = "one of the two: a GMNS folder has one class, no preloads and BPR";
        return Err(Error::input("--gmns", format!("{name} beside it"), expected));
    }
    let warm = ("--warm", &arguments.warm);
    let files = outputs(arguments).map(|output| (output.option, output.path));
    for (name, path) in files.into_iter().chain([warm]) {
        if arguments.check.is_some() && path.is_some() {
            let expected = "one of the two: --check solves nothing";
            return Err(Error::input(name, "--check beside it", expected));
        }
    }
    // Path flows may take the place of those that they started from; nothing may take that of a network or its demand.
    let mut inputs = vec![PathBuf::from(&arguments.net)];
    inputs.extend(arguments.trips.clone());
    inputs.extend(arguments.link_table.clone());
    if let Some(classes) = &arguments.classes {
        let described = vehicle_classes::read(classes)?;
        inputs.extend(described.iter().map(|class| class.trips().to_owned()));
        inputs.push(classes.clone());
    }
    inputs.extend(formats::files(Path::new(&arguments.net)).unwrap_or_default());
    inputs.extend(arguments.import.files());
    let lost = ("--unreachable-pairs", &arguments.import.unreachable_pairs);
    for (name, path) in files.into_iter().chain([warm, lost]) {
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
    check_names(arguments)
}

/// Refuses files whose names end in another kind than they will hold, and two of one name.
fn check_names(arguments: &AssignArguments) -> Result<()> {
    let mut seen: Vec<(&str, PathBuf)> = Vec::new();
    let lost = Output {
        option: "--unreachable-pairs",
        word: "",
        path: &arguments.import.unreachable_pairs,
        endings: &["csv"],
    };
    for output in outputs(arguments).into_iter().chain([lost]) {
        let Some(path) = output.path else {
            continue;
        };
        // Devices and pipes take what comes.
        if path
            .metadata()
            .is_ok_and(|found| !found.is_file() && !found.is_dir())
        {
            continue;
        }
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        if !output.endings.is_empty() && !output.endings.contains(&&*ending) {
            let expected = format!("a name that ends in .{}", output.endings.join(" or ."));
            return Err(Error::input(output.option, path.display(), expected));
        }
        let whole = whole(path);
        if let Some((other, _)) = seen.iter().find(|(_, known)| *known == whole) {
            let found = format!("{}, as for {other}", path.display());
            return Err(Error::input(output.option, found, "a file of its own"));
        }
        seen.push((output.option, whole));
    }
    Ok(())
}

/// A path in one form, whether its file is there or not.
fn whole(path: &Path) -> PathBuf {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    match (folder.canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
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

    fn format(&self, network: &Network, solved: &ClassSolution) -> String {
        let rows = |text: &mut String, first: &str, path_flows| {
            for (from, to, links) in &self.links {
                let selected = select_link::select_links(path_flows, links);
                text.push_str(&select_link::format_rows(network, first, from, to, &selected));
            }
        };
        let mut text = format!("{}\n", select_link::HEADER);
        if solved.classes.is_empty() {
            rows(&mut text, "", &solved.total.path_flows);
        } else {
            text.insert_str(0, "class,");
        }
        for class in &solved.classes {
            rows(&mut text, &format!("{},", class.name), &class.path_flows);
        }
        text
    }
}

/// Writes every file that was asked for; all texts are made before the first is written.
pub(super) fn write(
    arguments: &AssignArguments,
    assignment: &Assignment,
    selection: &Selection<'_>,
    solved: &ClassSolution,
    report: &ImportReport,
) -> Result<()> {
    let Assignment {
        network,
        demand,
        roads,
        ..
    } = assignment;
    let mut files: Vec<(&Path, Vec<u8>)> = Vec::new();
    let ClassSolution {
        total: solution,
        classes,
    } = solved;
    let (flows, costs) = (&solution.link_flows, &solution.link_costs);
    if let Some(path) = &arguments.flows {
        files.push((path, flow_files::encode(path, assignment, solved)?));
    }
    if let Some(path) = &arguments.paths {
        let text = if classes.is_empty() {
            path_flows::format_paths(network, &solution.path_flows, costs)
        } else {
            path_flows::format_class_paths(network, classes)
        };
        files.push((path, text.into_bytes()));
    }
    if let Some(path) = &arguments.skims {
        files.push((path, skim_file(path, assignment, solved)?));
    }
    if let Some(path) = &arguments.selected {
        files.push((path, selection.format(network, solved).into_bytes()));
    }
    if let Some(path) = &arguments.convergence {
        let text = convergence::format_convergence(&solution.convergence);
        files.push((path, text.into_bytes()));
    }
    if let Some(path) = &arguments.geojson {
        let places = arguments.places(network)?;
        let text = geojson::format_roads(network, roads, &places, (flows, costs));
        files.push((path, text.into_bytes()));
    }
    if let Some(path) = &arguments.report {
        // A report without a map is one still.
        let places = arguments.places(network).ok();
        let mut written: Vec<&str> = outputs(arguments).iter().map(|output| output.option).collect();
        written.push("--unreachable-pairs");
        let command = typed("assign", &written);
        let page = page::render(assignment, solved, report, places.as_ref(), &command)?;
        files.push((path, page.into_bytes()));
    }
    let gmns = arguments.gmns.as_deref().map(|folder| {
        let places = arguments.places(network).ok();
        let extras = gmns::Extras {
            places: places.as_ref(),
            shapes: &roads.shapes,
            flows: Some((flows, costs)),
            minutes: roads.seconds / 60.0,
            length: roads.length,
        };
        let mut set = gmns::format_network(network, &extras);
        set.push(("demand.csv".to_owned(), gmns::format_demand(network, demand)));
        (folder, set)
    });
    // One that cannot be written keeps no other from being there, and each is named.
    let files = files.iter().map(|(path, bytes)| write_whole(path, bytes));
    let folder = gmns.iter().map(|(folder, set)| write_set(folder, set));
    let mut failures = files.chain(folder).filter_map(Result::err).peekable();
    while let Some(failure) = failures.next() {
        if failures.peek().is_none() {
            return Err(failure);
        }
        kit::remark!("error: {failure}");
    }
    Ok(())
}

/// Skims of the kind that the file's name asks for.
fn skim_file(path: &Path, assignment: &Assignment, solved: &ClassSolution) -> Result<Vec<u8>> {
    let network = &assignment.network;
    let classes = assignment.classes.iter().zip(&solved.classes);
    let mut skims = Vec::new();
    for (class, flows) in classes {
        let own = skims::class_skims(network, class, &flows.link_costs)?;
        skims.push((class.name.as_str(), own));
    }
    let of_classes = !skims.is_empty();
    if !of_classes {
        skims.push(("", skims::skims(network, &solved.total.link_costs)?));
    }
    match path.extension().and_then(OsStr::to_str) {
        #[cfg(feature = "omx")]
        Some("omx") => skims::format_omx(network, &skims),
        _ if of_classes => Ok(skims::format_class_skims(network, &skims).into_bytes()),
        _ => Ok(skims::format_skims(network, &skims[0].1).into_bytes()),
    }
}

/// The paths to start from, of each class or the only ones; none if no file was given.
pub(super) fn start(arguments: &AssignArguments, assignment: &Assignment) -> Result<Vec<PathFlows>> {
    let Some(path) = &arguments.warm else {
        return Ok(Vec::new());
    };
    let (text, network) = (Text::read(path)?, &assignment.network);
    if assignment.classes.is_empty() {
        return Ok(vec![path_flows::read_paths(&text, network)?]);
    }
    let names: Vec<&str> = assignment
        .classes
        .iter()
        .map(|class| class.name.as_str())
        .collect();
    path_flows::read_class_paths(&text, network, &names)
}

/// What was written, with a word for each, in the order of the options.
pub(super) fn written(arguments: &AssignArguments) -> impl Iterator<Item = (&'static str, &Path)> {
    let files = outputs(arguments).into_iter();
    files.filter_map(|output| output.path.as_deref().map(|path| (output.word, path)))
}
