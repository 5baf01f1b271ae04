//! What is attacked: a file, and what the product does with it.

use crate::frames;
use assignment::check::evaluate;
use assignment::demand::Demand;
use assignment::formats::{self, ImportOptions};
use assignment::imported_demand::Unreachable;
use assignment::{Network, Objective, Result, geojson, omx, path_flows, text, uninterrupted};
use firmware::actor::Actor;
use firmware::table::Table;
use firmware::tables::DISTILLED;
use flate2::{Compression, write::GzEncoder};
use host_sim::assign::{AssignSource, Assignment};
use host_sim::command::assign::read_flows;
use host_sim::command::sweep::GridArguments;
use host_sim::experiment::ExperimentSource;
use host_sim::mobility::{MobilitySource, read_source};
use host_sim::policy::clock;
use host_sim::report::table;
use host_sim::scenario::ScenarioSource;
use host_sim::weight_table::WeightTable;
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use system_tests::table_builder::seal;
use trainer::laboratory::actors::{ActorForm, Actors};
use trainer::laboratory::state::{Part, State};
use trainer::laboratory::{checkpoint, random};
use trainer::run_folder::{RunFolder, RunIdentity};
use trainer::study::Plan;
use trainer::{ConfigurationSource, Network as ActorNetwork, Preset, actor_file};

/// A file, and what the product does with it.
pub struct Target {
    pub name: &'static str,
    /// Where the input stands in the scene.
    pub file: &'static str,
    pub seeds: Seeds,
    /// Reads the input, and uses what was read.
    pub run: fn(&Path) -> Result<()>,
}

/// What mutations begin with.
pub enum Seeds {
    /// The scene's own file.
    File,
    /// Other files of the scene too.
    Also(&'static [&'static str]),
    /// What the product writes.
    Made(fn(&Path) -> Vec<Vec<u8>>),
}

const fn target(
    name: &'static str,
    file: &'static str,
    seeds: Seeds,
    run: fn(&Path) -> Result<()>,
) -> Target {
    Target {
        name,
        file,
        seeds,
        run,
    }
}

/// All of them.
pub const TARGETS: &[Target] = &[
    target("tntp_network", "braess_net.tntp", Seeds::File, braess),
    target("tntp_trips", "braess_trips.tntp", Seeds::File, braess),
    target("tntp_nodes", "sioux_node.tntp", Seeds::File, |scene| {
        let network =
            formats::import_network(&scene.join("sioux_net.tntp"), &ImportOptions::default())?.network;
        formats::read_places(
            &scene.join("sioux_net.tntp"),
            Some(&scene.join("sioux_node.tntp")),
            &network,
        )
        .map(drop)
    }),
    target("gmns_nodes", "gmns/node.csv", Seeds::File, gmns),
    target("gmns_links", "gmns/link.csv", Seeds::File, gmns),
    target("gmns_config", "gmns/config.csv", Seeds::File, gmns),
    target("gmns_movements", "gmns/movement.csv", Seeds::File, gmns),
    target("gmns_groups", "gmns/use_group.csv", Seeds::File, gmns),
    target("gmns_geometry", "gmns/geometry.csv", Seeds::File, gmns),
    target("gmns_demand", "gmns/demand.csv", Seeds::File, gmns),
    target("sumo_network", "town.net.xml", Seeds::File, |scene| {
        sumo(scene, "trips.xml")
    }),
    target(
        "sumo_routes",
        "routes.xml",
        Seeds::Also(&["trips.xml"]),
        |scene| sumo(scene, "routes.xml"),
    ),
    target("sumo_zones", "taz.xml", Seeds::File, |scene| {
        sumo(scene, "routes.xml")
    }),
    target("pairs", "pairs.csv", Seeds::File, |scene| {
        trips(scene, "pairs.csv")
    }),
    target("matrix", "matrix.csv", Seeds::File, |scene| {
        trips(scene, "matrix.csv")
    }),
    target("omx", "matrix.omx", Seeds::Made(matrices), |scene| {
        trips(scene, "matrix.omx")
    }),
    target(
        "packed_network",
        "packed_net.tntp",
        Seeds::Made(|scene| vec![packed(scene, "braess_net.tntp")]),
        |scene| {
            use_assignment(&AssignSource {
                net: Some(scene.join("packed_net.tntp")),
                ..source(scene)
            })
        },
    ),
    target("turns", "turns.csv", Seeds::File, |scene| {
        let mut source = source(scene);
        source.import.turns = Some(scene.join("turns.csv"));
        use_assignment(&source)
    }),
    target("link_table", "links.csv", Seeds::File, classes),
    target("classes", "classes.toml", Seeds::File, classes),
    target("flows", "flows.csv", Seeds::File, |scene| {
        flows(scene, "flows.csv")
    }),
    target("published_flows", "flow.tntp", Seeds::File, |scene| {
        flows(scene, "flow.tntp")
    }),
    target("parquet_flows", "flows.parquet", Seeds::Made(parquet), |scene| {
        flows(scene, "flows.parquet")
    }),
    target("paths", "paths.csv", Seeds::File, |scene| {
        let assignment = source(scene).read()?;
        let paths = path_flows::read_paths(&text::read(&scene.join("paths.csv"))?, &assignment.network)?;
        use_solution(&assignment, &[paths])
    }),
    target("trace", "fcd.xml", Seeds::File, |scene| moved(scene, "fcd.xml")),
    target(
        "packed_trace",
        "fcd.xml.gz",
        Seeds::Made(|scene| vec![packed(scene, "fcd.xml")]),
        |scene| moved(scene, "fcd.xml.gz"),
    ),
    target("scenario", "scenario.toml", Seeds::Made(scenarios), |scene| {
        few_slots(Some(scene.join("scenario.toml")), read_source("grid")?)
    }),
    target("grid", "grid.toml", Seeds::File, |scene| {
        let arguments = GridArguments {
            grid: scene.join("grid.toml"),
            seeds: None,
        };
        let grid = arguments.read()?;
        let mut points = (0..grid.points().min(20)).map(|index| grid.point(index));
        points.try_for_each(|point| grid.task(&point).map(drop))
    }),
    target("configuration", "mixture.toml", Seeds::File, |scene| {
        configuration(Some(scene.join("mixture.toml")))
            .read()
            .map(|read| drop(RunIdentity::new(1, read).to_json()))
    }),
    target("plan", "plan.toml", Seeds::File, |scene| {
        Plan::read(&scene.join("plan.toml")).map(drop)
    }),
    target("weight_table", "table.bin", Seeds::Made(tables), |scene| {
        infer(WeightTable::read(&scene.join("table.bin"))?)
    }),
    target(
        "sealed_table",
        "body.bin",
        Seeds::Made(|_| vec![body(DISTILLED)]),
        |scene| {
            let mut bytes = std::fs::read(scene.join("body.bin"))
                .map_err(|source| kit::error::Error::file(scene, source))?;
            bytes.resize(bytes.len().max(12), 0);
            infer(WeightTable::new("table", seal(bytes))?)
        },
    ),
    target(
        "checkpoint",
        "checkpoint.safetensors",
        Seeds::Made(checkpoints),
        |scene| {
            let path = scene.join("checkpoint.safetensors");
            let bytes = std::fs::read(&path).map_err(|source| kit::error::Error::file(&path, source))?;
            let no_part = |name: &str| Err(kit::error::Error::input(name, "a part", "none"));
            checkpoint::from_bytes("checkpoint", &bytes, &[run()], no_part)?
                .0
                .check_finite()
        },
    ),
    target(
        "replay_part",
        "part.safetensors.gz",
        Seeds::Made(|_| vec![replay_part().1]),
        |scene| {
            let path = scene.join("part.safetensors.gz");
            let bytes = std::fs::read(&path).map_err(|source| kit::error::Error::file(&path, source))?;
            checkpoint::part_from_bytes("part", &bytes, replay_part().0).map(drop)
        },
    ),
    target("actor", "actor.safetensors", Seeds::Made(actors), |scene| {
        let actors = actor_file::read(&scene.join("actor.safetensors"))?;
        let inputs = vec![1.0; actors.form.observation.inputs()];
        assert!(
            actors
                .networks
                .iter()
                .all(|network| network.forward(&inputs).iter().all(|score| score.is_finite()))
        );
        Ok(())
    }),
    target("identity", "run.json", Seeds::Made(identities), |scene| {
        RunFolder::new(scene)
            .read_identity()
            .map(|read| drop(read.map(|read| read.to_json())))
    }),
    target(
        "session",
        "frames.bin",
        Seeds::Made(|_| frames::seeds()),
        frames::run,
    ),
];

/// An assignment that ends soon, of the smallest network.
fn source(scene: &Path) -> AssignSource {
    AssignSource {
        net: Some(scene.join("braess_net.tntp")),
        trips: Some(scene.join("braess_trips.tntp")),
        unreachable: Unreachable::Drop,
        max_iterations: 3,
        threads: 1,
        ..AssignSource::default()
    }
}

/// Reads and solves.
fn use_assignment(source: &AssignSource) -> Result<()> {
    use_solution(&source.read()?, &[])
}

/// Solves, and writes what came out: flows are numbers, and JSON is JSON.
fn use_solution(assignment: &Assignment, start: &[assignment::PathFlows]) -> Result<()> {
    let solution = assignment.solve(start, &mut uninterrupted)?;
    let total = &solution.total;
    let amount = |number: &f64| number.is_finite() && *number >= 0.0;
    assert!(total.link_flows.iter().all(amount) && total.link_costs.iter().all(amount));
    assert!(amount(&total.relative_gap) && total.objective.is_finite());
    let _text = assignment.to_json(&solution).to_string();
    Ok(())
}

fn braess(scene: &Path) -> Result<()> {
    use_assignment(&source(scene))
}

fn trips(scene: &Path, name: &str) -> Result<()> {
    use_assignment(&AssignSource {
        trips: Some(scene.join(name)),
        ..source(scene)
    })
}

fn classes(scene: &Path) -> Result<()> {
    use_assignment(&AssignSource {
        trips: None,
        classes: Some(scene.join("classes.toml")),
        links: Some(scene.join("links.csv")),
        ..source(scene)
    })
}

fn gmns(scene: &Path) -> Result<()> {
    let source = AssignSource {
        net: Some(scene.join("gmns")),
        trips: None,
        ..source(scene)
    };
    use_on_map(&source)
}

fn sumo(scene: &Path, trips: &str) -> Result<()> {
    let mut source = AssignSource {
        net: Some(scene.join("town.net.xml")),
        trips: Some(scene.join(trips)),
        ..source(scene)
    };
    source.import.taz = (trips == "routes.xml").then(|| scene.join("taz.xml"));
    use_on_map(&source)
}

/// Reads and solves, and draws a map where the nodes have places.
fn use_on_map(source: &AssignSource) -> Result<()> {
    let assignment = source.read()?;
    use_solution(&assignment, &[])?;
    let network = &assignment.network;
    let places = formats::read_places(source.net.as_deref().unwrap(), None, network)?;
    let zeros = vec![0.0; network.links().len()];
    let map = geojson::format_roads(network, &assignment.roads, &places, (&zeros, &zeros));
    let _map: serde_json::Value = serde_json::from_str(&map).unwrap();
    Ok(())
}

/// Reads flows, and judges them.
fn flows(scene: &Path, name: &str) -> Result<()> {
    let Assignment { network, demand, .. } = source(scene).read()?;
    judge(&network, &demand, &read_flows(&scene.join(name), &network, &[])?)
}

fn judge(network: &Network, demand: &Demand, flows: &[f64]) -> Result<()> {
    let judged = evaluate(network, demand, Objective::UserEquilibrium, flows)?;
    assert!(
        judged.relative_gap.is_finite() && judged.objective.is_finite(),
        "{judged:?}"
    );
    Ok(())
}

fn moved(scene: &Path, name: &str) -> Result<()> {
    let path: PathBuf = scene.join(name);
    few_slots(None, read_source(path.to_str().unwrap())?)
}

/// A few slots of a cell.
fn few_slots(file: Option<PathBuf>, source: Box<dyn MobilitySource>) -> Result<()> {
    let experiment = ExperimentSource {
        scenario: ScenarioSource {
            file,
            ..ScenarioSource::default()
        },
        policies: vec![&clock::KIND],
        worlds: Some(1),
        slots: Some(3),
        warmup: 0,
        ..ExperimentSource::default()
    };
    let experiment = experiment.read_with(source)?;
    let table = experiment.table.parse()?;
    let (ages, _) = experiment
        .simulation()
        .run_policy(&clock::KIND, &table, |_, _| ())?;
    assert!(ages.mean_ms.is_finite());
    Ok(())
}

/// Runs a table that was accepted.
fn infer(table: WeightTable) -> Result<()> {
    let table: Table<'_> = table.parse()?;
    let inputs = table.network().widths().next().unwrap_or_default();
    let mut actor = Actor::new(table);
    for input in [-128, 0, 127] {
        let _outputs = actor.infer(&vec![input; inputs]);
    }
    Ok(())
}

/// The scene's own, and one whose key is compared with all known ones.
fn scenarios(scene: &Path) -> Vec<Vec<u8>> {
    let long = format!("[{}]\n", "vehicles".repeat(150_000));
    vec![
        std::fs::read(scene.join("scenario.toml")).unwrap(),
        long.into_bytes(),
    ]
}

fn tables(_: &Path) -> Vec<Vec<u8>> {
    vec![DISTILLED.to_vec()]
}

/// A table without its checksum, which is put right behind each mutation.
fn body(table: &[u8]) -> Vec<u8> {
    table[..table.len() - 4].to_vec()
}

fn packed(scene: &Path, name: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder
        .write_all(&std::fs::read(scene.join(name)).unwrap())
        .unwrap();
    encoder.finish().unwrap()
}

fn matrices(_: &Path) -> Vec<Vec<u8>> {
    let zones = ["1".to_owned(), "2".to_owned()];
    vec![omx::format(&zones, &[("trips", vec![0.0, 6.0, 0.0, 0.0])]).unwrap()]
}

fn parquet(_: &Path) -> Vec<Vec<u8>> {
    let nodes = |name: &str, nodes: [u64; 5]| table::Column::unsigned(name, nodes);
    let numbers = |name: &str, numbers: [f64; 5]| table::Column::number(name, numbers);
    let columns = vec![
        nodes("init_node", [1, 1, 3, 3, 4]),
        nodes("term_node", [3, 4, 2, 4, 2]),
        numbers("volume", [4.0, 2.0, 2.0, 2.0, 4.0]),
        numbers("cost", [40.0, 52.0, 52.0, 12.0, 40.0]),
    ];
    vec![table::Table::new(columns).unwrap().to_parquet().unwrap()]
}

fn configuration(file: Option<PathBuf>) -> ConfigurationSource {
    ConfigurationSource {
        preset: Preset::Ppo,
        file,
        settings: Vec::new(),
    }
}

/// What the run of checkpoints was told.
fn run() -> serde_json::Value {
    serde_json::json!({ "seed": 1 })
}

fn checkpoints(_: &Path) -> Vec<Vec<u8>> {
    let mut state = State::new(serde_json::json!({ "done": 7 }));
    state.put("weights", &[2, 2], vec![1.0_f32, -0.0, f32::MIN_POSITIVE, 3.5]);
    state.put("actions", &[3], vec![0_u8, 1, 255]);
    vec![checkpoint::to_bytes(&run(), &state, &BTreeMap::new()).unwrap()]
}

/// The checksum of a part, and its file.
fn replay_part() -> (u64, Vec<u8>) {
    let mut state = State::default();
    state.put("ages", &[2, 50], vec![7.0_f32; 100]);
    checkpoint::part_to_bytes(&Part(state.tensors)).unwrap()
}

fn actors(_: &Path) -> Vec<Vec<u8>> {
    use firmware::form::{ObservationForm, OutputForm};
    let of = |count: u32| Actors {
        form: ActorForm {
            observation: ObservationForm::Paper,
            output: OutputForm::SubChannelAndPower,
            noise: 0.1,
            min_vehicles: 5,
            max_vehicles: 5,
        },
        networks: (0..count)
            .map(|member| {
                ActorNetwork::random(
                    &[ObservationForm::Paper.inputs(), 3, 2],
                    &mut random::initial(1, member),
                )
            })
            .collect(),
    };
    [1, 2]
        .map(|count| actor_file::to_bytes(&of(count)).unwrap())
        .to_vec()
}

fn identities(_: &Path) -> Vec<Vec<u8>> {
    vec![
        RunIdentity::new(1, configuration(None).read().unwrap())
            .to_json()
            .to_string()
            .into_bytes(),
    ]
}
