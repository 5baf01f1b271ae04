//! Roads as SUMO's files.

use super::program::Programs;
use crate::journeys::roads::{Road, RoadMap, SPACING_M};
use kit::error::{Error, Result};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Length of a vehicle in m; the rest of [`SPACING_M`] is its gap (SUMO's default passenger car).
const LENGTH_M: f64 = 5.0;

/// How fast drivers speed up and slow down, in m/s². Chosen: with a car's usual 2.6 and 4.5 a merge of two full lanes into
/// one passes 1,500 vehicles an hour where the road is said to carry 1,800, and with these all of them. What is lost at
/// crossings is in a planning network's capacities already.
const ACCELERATION_M_PER_S2: (f64, f64) = (5.0, 9.0);

/// Shortest reaction in s that steps of 1 s allow.
const SHORTEST_REACTION_S: f64 = 1.0;

/// Files that a simulation reads.
#[derive(Debug)]
pub struct Files {
    /// The network.
    pub network: PathBuf,
    /// The types of vehicles.
    pub types: PathBuf,
}

/// Writes a network and the types of its vehicles to a folder.
///
/// # Errors
/// A file that cannot be written, or what SUMO's `netconvert` says of the network.
pub fn write(map: &RoadMap, folder: &Path, programs: &Programs) -> Result<Files> {
    let file = |name: &str| folder.join(name);
    for (name, text) in [
        ("nodes.nod.xml", nodes(map)),
        ("roads.edg.xml", edges(map)),
        ("turns.con.xml", connections(map)),
        ("types.add.xml", types(map)),
    ] {
        std::fs::write(file(name), text).map_err(|source| Error::file(&file(name), source))?;
    }
    let files = Files {
        network: file("roads.net.xml"),
        types: file("types.add.xml"),
    };
    let mut arguments: Vec<OsString> = Vec::new();
    for (option, path) in [
        ("--node-files", &file("nodes.nod.xml")),
        ("--edge-files", &file("roads.edg.xml")),
        ("--connection-files", &file("turns.con.xml")),
        ("--output-file", &files.network),
    ] {
        arguments.extend([option.into(), path.into()]);
    }
    for option in [
        "--no-internal-links",
        "--offset.disable-normalization",
        "--xml-validation=never",
    ] {
        arguments.push(option.into());
    }
    programs.convert(&arguments)?;
    Ok(files)
}

/// Crossings without rules: nobody waits for anybody.
fn nodes(map: &RoadMap) -> String {
    let mut text = String::from("<nodes>\n");
    for (index, (x_m, y_m)) in map.places_m().iter().enumerate() {
        let _ = writeln!(
            text,
            r#"<node id="{index}" x="{x_m}" y="{y_m}" type="unregulated"/>"#
        );
    }
    text + "</nodes>\n"
}

fn edges(map: &RoadMap) -> String {
    let mut text = String::from("<edges>\n");
    for (index, road) in map.roads().iter().enumerate() {
        let Road {
            from,
            to,
            length_m,
            free_speed_m_per_s,
            lanes,
            ..
        } = road;
        let _ = writeln!(
            text,
            r#"<edge id="{index}" from="{from}" to="{to}" numLanes="{lanes}" speed="{free_speed_m_per_s}" length="{length_m}"/>"#
        );
    }
    text + "</edges>\n"
}

/// From every lane to every onward road, back to where it came from included.
fn connections(map: &RoadMap) -> String {
    let mut text = String::from("<connections>\n");
    for (index, road) in map.roads().iter().enumerate() {
        for &onward in map.outgoing(road.to) {
            let lanes = map.roads()[onward as usize].lanes;
            for lane in 0..road.lanes.max(lanes) {
                let (from, to) = (lane.min(road.lanes - 1), lane.min(lanes - 1));
                let _ = writeln!(
                    text,
                    r#"<connection from="{index}" to="{onward}" fromLane="{from}" toLane="{to}"/>"#
                );
            }
        }
    }
    text + "</connections>\n"
}

/// A driver's type on a road: how closely it follows there, so that the road carries its capacity. SUMO knows one reaction
/// time a type, hence types of whole hundredths of a second.
pub fn vehicle_type(road: &Road) -> String {
    format!("reaction{}", reaction_hundredths(road))
}

fn reaction_hundredths(road: &Road) -> u32 {
    (100.0 * road.reaction_time_s().max(SHORTEST_REACTION_S)).round() as u32
}

fn types(map: &RoadMap) -> String {
    let reactions: BTreeSet<u32> = map.roads().iter().map(reaction_hundredths).collect();
    let gap_m = SPACING_M - LENGTH_M;
    let (accel, decel) = ACCELERATION_M_PER_S2;
    let mut text = String::from("<additional>\n");
    for hundredths in reactions {
        let reaction_s = f64::from(hundredths) / 100.0;
        let _ = writeln!(
            text,
            r#"<vType id="reaction{hundredths}" length="{LENGTH_M}" minGap="{gap_m}" tau="{reaction_s}" accel="{accel}" decel="{decel}" emergencyDecel="{decel}" sigma="0" speedFactor="1" speedDev="0" maxSpeed="100"/>"#
        );
    }
    text + "</additional>\n"
}
