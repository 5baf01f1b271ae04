//! Actors in the one form that evaluation, export, ONNX and safetensors understand.

use super::forms::{ObservationForm, OutputForm};
use crate::network::Network;
use firmware::units::{Period, SUB_CHANNELS};
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// What actors see and what their outputs mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActorForm {
    /// Meaning of the inputs.
    pub observation: ObservationForm,
    /// Meaning of the outputs.
    pub output: OutputForm,
    /// Fewest vehicles in the cells that they were trained in.
    pub min_vehicles: u32,
    /// Most.
    pub max_vehicles: u32,
}

/// Dense networks with ReLU between the layers: one that all vehicles share, or one for each vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Actors {
    /// What goes in and what comes out.
    pub form: ActorForm,
    /// All of the same widths. The last layer's outputs are before any tanh or softmax, which belongs to the form.
    pub networks: Vec<Network>,
}

/// Most vehicles of a cell with groups: three of 100.
const MOST_VEHICLES: u32 = (SUB_CHANNELS * Period::MAX as usize) as u32;

impl Actors {
    /// The network of a vehicle; with one network, everybody's.
    pub fn network(&self, vehicle: usize) -> &Network {
        match self.networks.as_slice() {
            [shared] => shared,
            own => &own[vehicle],
        }
    }

    /// Whether all vehicles run the same network.
    pub fn shared(&self) -> bool {
        self.networks.len() == 1
    }

    /// Checks widths against each other and against the form, and that all parameters are numbers.
    ///
    /// # Errors
    /// What does not fit.
    pub fn check(&self) -> Result<()> {
        let Some(first) = self.networks.first() else {
            return Err(Error::input("actors", "no network", "at least one"));
        };
        let widths = first.widths();
        let (least, most) = (self.form.min_vehicles, self.form.max_vehicles);
        if least == 0 || least > most || most > MOST_VEHICLES {
            let found = format!("{least} to {most} vehicles");
            let expected = format!("1 to {MOST_VEHICLES}, the fewest first");
            return Err(Error::input("actors", found, expected));
        }
        let expected = (self.form.observation.length(), self.form.output.length());
        if (widths.first(), widths.last()) != (Some(&expected.0), Some(&expected.1)) {
            let expected = format!("{} inputs and {} outputs", expected.0, expected.1);
            return Err(Error::input("actors", format!("widths {widths:?}"), expected));
        }
        for (vehicle, network) in self.networks.iter().enumerate() {
            if network.widths() != widths {
                let found = format!("widths {:?}", network.widths());
                return Err(Error::input(
                    format!("actor of vehicle {vehicle}"),
                    found,
                    format!("{widths:?} as of vehicle 0"),
                ));
            }
            for (index, layer) in network.layers.iter().enumerate() {
                let mut parameters = layer.weights.iter().chain(&layer.biases);
                if let Some(found) = parameters.find(|parameter| !parameter.is_finite()) {
                    let place = format!("actor of vehicle {vehicle}: layers.{index}");
                    return Err(Error::input(place, found, "finite numbers"));
                }
            }
        }
        Ok(())
    }
}
