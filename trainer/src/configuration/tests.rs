//! What presets, files and settings may say, and what they may not.

use super::*;
use kit::keys::{Kind, listed, value};

#[test]
fn presets_are_complete_and_valid() {
    for preset in Preset::ALL {
        let configuration = preset.with(&["scenario.cell.vehicles=7"]).unwrap();
        assert_eq!(configuration.scenario.cell.vehicles, 7);
        let written = serde_json::to_string(&configuration).unwrap();
        assert_eq!(
            serde_json::from_str::<Configuration>(&written).unwrap(),
            configuration
        );
    }
}

#[test]
fn bad_settings_name_key_and_expectation() {
    let message = |setting: &str| Preset::Evolution.with(&[setting]).unwrap_err().to_string();
    assert!(message("evolution.poulation=3").starts_with(
        "--set evolution.poulation: found an unknown key, expected evolution.population, or another key"
    ));
    assert_eq!(
        message("algorithm=ppo"),
        "algorithm: found \"ppo\", expected evolution, the algorithm of the preset"
    );
    assert_eq!(
        message("scenario.cell.vehicles=0"),
        "scenario.cell.vehicles: found 0, expected 1 to 10000 vehicles"
    );
    assert_eq!(
        message("scenario.cell.vehicles=4001"),
        "scenario.cell.vehicles: found 4001, expected at most 4000, the places of a ring"
    );
    assert_eq!(
        message("evolution.hidden=16"),
        "--set evolution.hidden: found 16, expected a list such as [64, 64]"
    );
    assert_eq!(
        message("evolution.elite=900"),
        "evolution.elite: found 900, expected at most half of evolution.population, which is 40"
    );
}

#[test]
fn forms_that_know_three_sub_channels_are_refused_elsewhere() {
    let message = |preset: Preset, sub_channels: u32, settings: &[&str]| {
        let number = format!("scenario.radio.sub_channels={sub_channels}");
        let read = preset.with(&[&[number.as_str()], settings].concat());
        read.err().map(|error| error.to_string())
    };
    for (preset, settings) in [
        (Preset::Paper, &[][..]),
        (Preset::Paper, &["maddpg.observation=firmware"]),
        (
            Preset::Paper,
            &["maddpg.observation=age-one-hot", "maddpg.action=actions"],
        ),
        (
            Preset::Companion,
            &["maddpg.observation=firmware", "maddpg.action=sub-channels"],
        ),
    ] {
        assert_eq!(message(preset, 3, settings), None);
        assert_eq!(
            message(preset, 4, settings).unwrap(),
            "scenario.radio.sub_channels: found 4, expected 3, which actors know unless their observation is \"firmware\" and \
             their action \"actions\""
        );
    }
    for preset in [
        Preset::Evolution,
        Preset::Freshlane,
        Preset::Ppo,
        Preset::FineTune,
    ] {
        for sub_channels in [1, 16] {
            assert_eq!(message(preset, sub_channels, &[]), None);
        }
        assert_eq!(
            message(preset, 17, &[]).unwrap(),
            "scenario.radio.sub_channels: found 17, expected at most 16, which units know"
        );
    }
}

/// From the lowest: a cell's preset, what the training preset and the user set for all cells, what the cell sets.
#[test]
fn cells_of_a_mixture_are_laid_over_their_presets() {
    let mixture = "mixture=[{ preset = 'street', weight = 1 }, { preset = 'edge', weight = 2, vehicles = [8, 9], \
                   set = ['cell.vehicles=9', 'feedback.place_loss=0.5'] }]";
    let read = Preset::FineTune
        .with(&[mixture, "scenario.cell.vehicles=30"])
        .unwrap();
    let [street, edge] = &read.mixture[..] else {
        panic!("{:?}", read.mixture)
    };
    let cell = |cell: &MixedCell| {
        (
            cell.scenario.cell.vehicles,
            cell.scenario.cell.replacement_probability,
        )
    };
    assert_eq!((cell(street), cell(edge)), ((30, 1e-3), (9, 1e-3)));
    assert!(street.scenario.fading.follows_speed && !edge.scenario.fading.follows_speed);
    assert_eq!(edge.scenario.radio.max_power_dbm, 23.0);
    assert_eq!((street.vehicles, edge.vehicles), ([3, 72], [8, 9]));
    assert_eq!((edge.weight, edge.scenario.feedback.place_loss), (2.0, 0.5));
    let written = serde_json::to_string(&read).unwrap();
    assert_eq!(serde_json::from_str::<Configuration>(&written).unwrap(), read);
    // A run in one cell is written as before there were mixtures.
    let alone = Preset::FineTune.with(&[]).unwrap();
    assert!(!serde_json::to_string(&alone).unwrap().contains("mixture"));
    assert_eq!(alone.cells(), Mixture::alone(&alone.scenario, [3, 72]));
}

#[test]
fn mixtures_that_do_not_fit_are_refused_by_their_key() {
    let message = |preset: Preset, cells: &str, setting: &str| {
        let mixture = format!("mixture=[{cells}]");
        preset.with(&[&mixture, setting]).unwrap_err().to_string()
    };
    let two =
        "{ preset = 'paper', weight = 1 }, { preset = 'edge', weight = 1, set = ['radio.sub_channels=4'] }";
    for (preset, cells, setting, expected) in [
        (
            Preset::FineTune,
            "{ preset = 'stret', weight = 1 }",
            "ppo.batches=2",
            "mixture[0].preset: found \"stret\", expected \"paper\", \"companion\", \"street\", \"edge\"",
        ),
        (
            Preset::FineTune,
            "{ preset = 'street' }",
            "ppo.batches=2",
            "mixture[0].weight: found none, expected 1e-6 to 1e6",
        ),
        (
            Preset::Ppo,
            "{ preset = 'paper', weight = 1 }, { preset = 'edge', weight = 9 }",
            "ppo.batches=3",
            "mixture[0].weight: found 1, none for \"paper\", expected enough for one of the 3 ppo.batches",
        ),
        (
            Preset::Paper,
            two,
            "maddpg.episodes=9",
            "mixture[1]: radio.sub_channels: found 4, expected 3, which actors know unless their observation is \
             \"firmware\" and their action \"actions\"",
        ),
        (
            Preset::Freshlane,
            two,
            "maddpg.episodes=9",
            "mixture: found 2 cells, expected none with maddpg, which learns in `scenario` alone; ppo learns in mixtures",
        ),
    ] {
        assert_eq!(message(preset, cells, setting), expected);
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, "[[mixture]]\npreset = \"edge\"\nweight = 0").unwrap();
    let source = ConfigurationSource {
        preset: Preset::Ppo,
        file: Some(file.clone()),
        settings: Vec::new(),
    };
    assert_eq!(
        source.read().unwrap_err().to_string(),
        format!(
            "{}: key mixture[0].weight: found 0, expected 1e-6 to 1e6",
            file.display()
        )
    );
}

/// Every learner is paid what the name says: minus the age over 100 slots is the age that metrics show.
#[test]
fn a_named_reward_is_paid_by_every_algorithm() {
    let evolution = [
        "evolution.population=4",
        "evolution.elite=2",
        "evolution.slots=40",
    ];
    let maddpg = [
        "maddpg.worlds=2",
        "maddpg.slots=80",
        "maddpg.replay=160",
        "maddpg.warm_up_slots=140",
    ];
    let ppo = [
        "ppo.batches=2",
        "ppo.updates=2",
        "ppo.slots=8",
        "ppo.max_vehicles=9",
    ];
    let vdn = [
        "vdn.worlds=2",
        "vdn.slots=40",
        "vdn.replay=80",
        "vdn.warm_up_slots=70",
    ];
    for (preset, settings, scale) in [
        (Preset::Evolution, &evolution[..], 1.0),
        (Preset::Freshlane, &maddpg, 1.0),
        (Preset::Ppo, &ppo, 0.03),
        (Preset::Vdn, &vdn, 1.0),
    ] {
        let named = |name: &str| preset.with(&[settings, &[name]].concat()).unwrap();
        let metrics = named("reward=own").learner(2).unwrap().advance();
        let (reward, age) = (
            metrics.get("mean_reward").unwrap(),
            metrics.get("mean_age_ms").unwrap(),
        );
        assert!(
            (reward / scale + age / 100.0).abs() < 1e-6 * age,
            "{preset:?}: {reward}, {age}"
        );
        assert_eq!(named("reward=paper").reward, Some(RewardName::Paper));
        assert_eq!(named("reward=algorithm").reward, None);
    }
    let refused = Preset::Vdn.with(&["reward=papr"]).unwrap_err().to_string();
    assert!(
        refused.ends_with("found \"papr\", expected \"algorithm\", \"own\", \"team\", \"paper\""),
        "{refused}"
    );
}

#[test]
fn every_key_of_a_preset_has_a_meaning_and_a_source() {
    let presets: Vec<Table> = Preset::ALL
        .iter()
        .map(|preset| preset.values().unwrap())
        .collect();
    for (name, key) in listed(Layout::KEYS) {
        assert!(
            presets.iter().any(|values| value(values, &name).is_some()),
            "{name}"
        );
        assert!(!key.meaning.is_empty() && !key.source.is_empty(), "{name}");
    }
}

/// Both ends of a documented range are read, what lies beyond them is refused in the words of the range.
#[test]
fn documented_ranges_are_what_is_checked() {
    for (preset, section) in [
        (Preset::Evolution, "evolution."),
        (Preset::Paper, "maddpg."),
        (Preset::Ppo, "ppo."),
    ] {
        for (name, key) in listed(Layout::KEYS) {
            let (kind, length) = match key.kind {
                Kind::List(each, length) => (*each, Some(length.unwrap_or(1))),
                kind => (kind, None),
            };
            if !name.starts_with(section) || !matches!(kind, Kind::Whole | Kind::Number) {
                continue;
            }
            let refusal = format!("{name}: found ");
            let refused = |value: f64| {
                let value = match length {
                    Some(length) => format!("[{}]", vec![value.to_string(); length].join(", ")),
                    None => value.to_string(),
                };
                let error = preset.with(&[&format!("{name}={value}")]).err();
                // An end may still contradict another key.
                error.is_some_and(|error| {
                    let error = error.to_string();
                    error.starts_with(&refusal) && error.ends_with(&format!(", expected {}", key.range()))
                })
            };
            let (below, above) = match kind {
                Kind::Whole => (key.least - 1.0, key.most + 1.0),
                _ => (key.least.next_down(), key.most.next_up()),
            };
            assert!(!refused(key.least) && !refused(key.most), "{name}");
            assert!(refused(below) && refused(above), "{name}");
        }
    }
}
