//! Actors in the one form that evaluation, export, ONNX and safetensors understand.

use crate::network::Network;
use firmware::form::{ObservationForm, OutputForm};
use firmware::ring::MAX_PLACES;
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// What actors see, what their outputs mean, and whom they were trained for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "WrittenForm", into = "WrittenForm")]
pub struct ActorForm {
    /// Meaning of the inputs.
    pub observation: ObservationForm,
    /// Meaning of the outputs.
    pub output: OutputForm,
    /// Standard deviation of the noise that continuous actions explore with, before they are cut to -1 to 1.
    pub noise: f32,
    /// Fewest vehicles in the cells that they were trained in.
    pub min_vehicles: u32,
    /// Most.
    pub max_vehicles: u32,
}

/// An [`ActorForm`] in files.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenForm {
    observation: ObservationForm,
    output: WrittenOutput,
    min_vehicles: u32,
    max_vehicles: u32,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenOutput {
    form: OutputForm,
    /// Of [`OutputForm::SubChannelAndPower`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    noise: Option<f32>,
    /// Of [`OutputForm::SubChannels`], which without it is [`OutputForm::SendingSubChannels`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    silence: Option<bool>,
}

impl From<WrittenForm> for ActorForm {
    fn from(written: WrittenForm) -> Self {
        let WrittenOutput { form, noise, silence } = written.output;
        Self {
            observation: written.observation,
            output: form.with_silence(silence.unwrap_or(true)),
            noise: noise.unwrap_or(0.0),
            min_vehicles: written.min_vehicles,
            max_vehicles: written.max_vehicles,
        }
    }
}

impl From<ActorForm> for WrittenForm {
    fn from(form: ActorForm) -> Self {
        let (output, silence) = match form.output {
            OutputForm::SubChannels => (form.output, Some(true)),
            OutputForm::SendingSubChannels => (OutputForm::SubChannels, Some(false)),
            other => (other, None),
        };
        Self {
            observation: form.observation,
            output: WrittenOutput {
                form: output,
                noise: (output == OutputForm::SubChannelAndPower).then_some(form.noise),
                silence,
            },
            min_vehicles: form.min_vehicles,
            max_vehicles: form.max_vehicles,
        }
    }
}

/// Dense networks with ReLU between the layers: one that all vehicles share, or one for each vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct Actors {
    /// What goes in and what comes out.
    pub form: ActorForm,
    /// All of the same widths. The last layer's outputs are before any tanh or softmax, which belongs to the form.
    pub networks: Vec<Network>,
}

/// Most vehicles of a cell: the places of a ring.
const MOST_VEHICLES: u32 = MAX_PLACES as u32;

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
        let expected = (self.form.observation.inputs(), self.form.output.outputs());
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
            for (index, layer) in network.layers().enumerate() {
                let mut parameters = layer.weights.iter().chain(layer.biases);
                if let Some(found) = parameters.find(|parameter| !parameter.is_finite()) {
                    let place = format!("actor of vehicle {vehicle}: layers.{index}");
                    return Err(Error::input(place, found, "finite numbers"));
                }
            }
        }
        Ok(())
    }
}
