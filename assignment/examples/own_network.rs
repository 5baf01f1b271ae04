//! Two towns, a bypass and a bridge: who drives where, and what each of them pays.
//!
//! ```console
//! $ cargo run --release -p assignment --example own_network
//! ```

use assignment::{
    CostWeights, Demand, Link, Network, NodeNumbering, Objective, Options, Result, Trip, assign,
};

fn main() -> Result<()> {
    // Nodes count from 1 and zones come first: trips start and end in 1 and 2. Nodes 3 and 4 are junctions.
    let numbering = NodeNumbering {
        zones: 2,
        nodes: 4,
        first_thru_node: 3,
    };
    // Minutes without traffic, vehicles an hour, and the cost function of the Bureau of Public Roads with its usual numbers.
    let road = |init_node, term_node, free_flow_time, capacity| Link {
        init_node,
        term_node,
        capacity,
        free_flow_time,
        b: 0.15,
        power: 4.0,
        length: 0.0,
        toll: 0.0,
    };
    let links = vec![
        road(1, 3, 2.0, 6_000.0),
        road(3, 4, 8.0, 1_800.0),  // the bridge
        road(3, 4, 12.0, 4_000.0), // the bypass
        road(4, 2, 2.0, 6_000.0),
    ];
    let names = ["to the junction", "bridge", "bypass", "from the junction"];
    let network = Network::new(numbering, links, CostWeights::default())?;
    let demand = Demand::new(
        2,
        &[Trip {
            origin: 1,
            destination: 2,
            volume: 4_500.0,
        }],
    )?;
    for (objective, name) in [
        (
            Objective::UserEquilibrium,
            "user equilibrium: nobody gains by changing route",
        ),
        (
            Objective::SystemOptimum,
            "system optimum: the least time for all together",
        ),
    ] {
        let options = Options {
            objective,
            gap: 1e-10,
            ..Options::default()
        };
        let solution = assign(&network, &demand, &options)?;
        println!("{name}");
        for ((name, flow), time) in names.iter().zip(&solution.link_flows).zip(&solution.link_costs) {
            println!("  {name:18} {flow:6.0} vehicles/h  {time:5.2} min");
        }
        let mean = solution.total_travel_time / demand.total();
        println!(
            "  a trip takes {mean:.2} min, relative gap {:.0e}",
            solution.relative_gap
        );
    }
    Ok(())
}
