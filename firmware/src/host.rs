//! What the image would run, for people: the built-in table in words.

use firmware::lots::Identity;
use firmware::network::MAX_LAYERS;
use firmware::table::Table;
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use std::process::ExitCode;

/// Prints the built-in table; fails if a unit would refuse it.
pub fn describe_built_in_table() -> ExitCode {
    // A unit and not the bare table, so that a build with logging logs what the image would.
    let unit = Unit::new(DISTILLED, Identity(0));
    let outcome = match unit.table() {
        Ok(table) => {
            print!("{}", description(table));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("built-in table of {} bytes: {error}", DISTILLED.len());
            eprintln!(
                "a unit with this image stays silent; `cargo run --release -p trainer -- export` writes a table"
            );
            ExitCode::FAILURE
        }
    };
    #[cfg(feature = "defmt")]
    println!("{}", crate::host_logger::summary());
    outcome
}

fn description(table: &Table<'_>) -> String {
    let widths: Vec<usize> = table.network().widths().collect();
    let geometry = widths.iter().map(usize::to_string).collect::<Vec<_>>().join("-");
    let products: usize = widths
        .windows(2)
        .map(|layer| layer.iter().product::<usize>())
        .sum();

    let provenance = table.provenance();
    let revision = if provenance.revision == [0; 20] {
        "unknown".to_owned()
    } else {
        provenance
            .revision
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect()
    };
    let modified = if provenance.modified {
        " with uncommitted changes"
    } else {
        ""
    };

    // Scales count 2^-24; the inputs' comes first, then one for every layer.
    let scales = table.scales();
    let scales = scales.iter().take(widths.len().min(MAX_LAYERS + 1));
    let scales = scales
        .map(|&scale| format!("{:.6}", f64::from(scale) / f64::from(1 << 24)))
        .collect::<Vec<_>>()
        .join(", ");

    let plan = table.power_plan();
    let levels = plan.joiner_levels.map(|level| level.to_string()).join(", ");
    let checksum = table.bytes().last_chunk().copied().map_or(0, u32::from_le_bytes);
    format!(
        "geometry            {geometry} ({products} multiplications)\n\
         size                {size} bytes, CRC-32 {checksum:#010x}\n\
         observation         {observation:?}\n\
         outputs             {outputs:?}\n\
         trained for         up to {vehicles} vehicles on up to {sub_channels} sub-channels\n\
         training seed       {seed}\n\
         sources             {revision}{modified}\n\
         scales              {scales} (inputs, then each layer)\n\
         required SINR       {sinr} dB\n\
         joiner levels       {levels} dB over noise\n",
        size = table.bytes().len(),
        observation = table.observation_form(),
        outputs = table.output_form(),
        vehicles = table.max_vehicles(),
        sub_channels = table.max_sub_channels().count(),
        seed = provenance.seed,
        sinr = table.required_sinr(),
    )
}
