//! Learners that go on from the actors and critics of other runs.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use std::path::Path;
use std::time::Duration;
use trainer::configuration::{Configuration, ConfigurationSource, Preset};
use trainer::laboratory::learner::Learner;
use trainer::laboratory::state::State;
use trainer::run_folder::{GoOn, RunFolder, RunIdentity};
use trainer::training::{Conduct, train};

const PPO: &[&str] = &[
    "ppo.hidden=[8]",
    "ppo.critic_hidden=[6]",
    "ppo.episodes=2",
    "ppo.batches=2",
    "ppo.updates=2",
    "ppo.slots=8",
    "ppo.max_vehicles=9",
];

const FRESHLANE: &[&str] = &[
    "scenario.cell.vehicles=4",
    "maddpg.episodes=2",
    "maddpg.worlds=2",
    "maddpg.slots=20",
    "maddpg.replay=80",
    "maddpg.warm_up_slots=10",
    "maddpg.batch=8",
    "maddpg.actor_hidden=[8]",
];

fn configuration(preset: Preset, settings: &[&[&str]]) -> Configuration {
    let settings = settings
        .concat()
        .iter()
        .map(|&setting| setting.to_owned())
        .collect();
    let file = None;
    ConfigurationSource {
        preset,
        file,
        settings,
    }
    .read()
    .unwrap()
}

fn run(folder: &Path, configuration: Configuration) {
    let conduct = Conduct {
        go_on: GoOn::No,
        checkpoint_every: Duration::ZERO,
    };
    let _report = train(&RunIdentity::new(3, configuration), folder, &conduct, |_| ()).unwrap();
}

fn begun(preset: Preset, settings: &[&[&str]]) -> Box<dyn Learner> {
    configuration(preset, settings).learner(5).unwrap()
}

/// Values of all tensors whose names begin so.
fn of(state: &State, prefix: &str) -> State {
    let mut part = state.clone();
    part.parts.clear();
    part.counters = serde_json::Value::Null;
    part.tensors.retain(|name, _| name.starts_with(prefix));
    assert!(!part.tensors.is_empty(), "{prefix}");
    part
}

#[test]
fn every_algorithm_goes_on_from_the_actors_and_critics_of_another_run() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("ppo"), folder.path().join("freshlane"));
    let text = |key: &str, folder: &Path| format!("{key}='{}'", folder.display());
    run(&first, configuration(Preset::Ppo, &[PPO]));
    let actor = RunFolder::new(&first).read_actors().unwrap().networks;

    let from = text("evolution.first_actor", &first);
    let evolution = begun(Preset::Evolution, &[&["evolution.hidden=[8]", &from]]);
    assert_eq!(evolution.actors().networks, actor);

    let from = [text("ppo.first_actor", &first), text("ppo.first_critics", &first)];
    let ppo = begun(Preset::Ppo, &[PPO, &[&from[0], &from[1]]]);
    assert_eq!(ppo.actors().networks, actor);
    let saved = trainer::first_networks::state(&first, "").unwrap();
    assert_eq!(of(&ppo.state(), "critic"), of(&saved, "critic"));

    // One network for all becomes everybody's own.
    let from = text("maddpg.first_actor", &first);
    let own = ["maddpg.shared=false", &from];
    let maddpg = begun(Preset::Freshlane, &[FRESHLANE, &own]);
    assert_eq!(maddpg.actors().networks, vec![actor[0].clone(); 4]);

    run(&second, configuration(Preset::Freshlane, &[FRESHLANE, &[&from]]));
    let critics = text("maddpg.first_critics", &second);
    let mut maddpg = begun(Preset::Freshlane, &[FRESHLANE, &[&from, &critics]]);
    let saved = trainer::first_networks::state(&second, "").unwrap();
    for kind in ["global_critics", "local_critics"] {
        assert_eq!(of(&maddpg.state(), kind), of(&saved, kind));
    }
    let _metrics = maddpg.advance();

    let message = |preset: Preset, settings: &[&[&str]]| {
        let refused = configuration(preset, settings).learner(5).err();
        refused.map(|error| error.to_string()).unwrap_or_default()
    };
    let other_form = message(Preset::Paper, &[&[&from]]);
    assert!(
        other_form
            .contains("found observation Ring and action Actions, expected observation Paper and action"),
        "{other_form}"
    );
    let other_widths = message(
        Preset::Freshlane,
        &[FRESHLANE, &["maddpg.actor_hidden=[9]", &from]],
    );
    assert!(other_widths.contains("found 1 of widths [22, 8, 7], expected 1 of widths [22, 9, 7]"));
    let others = [
        text("maddpg.first_critics", &first),
        text("maddpg.first_critics", folder.path()),
    ];
    let of_another_algorithm = message(Preset::Freshlane, &[FRESHLANE, &[&others[0]]]);
    assert!(
        of_another_algorithm.starts_with("maddpg.first_critics: counters: found"),
        "{of_another_algorithm}"
    );
    assert!(message(Preset::Freshlane, &[FRESHLANE, &[&others[1]]]).contains("which does not exist"));
}
