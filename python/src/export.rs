//! A float network as a firmware table, through the trainer's quantiser, and how far the two agree.

use crate::error::{check_range, exception, value_error};
use crate::scenario::{Scenario, Setting};
use crate::table::{Table, input_rows};
use firmware::decision::ACTIONS;
use firmware::form::{ObservationForm, OutputForm};
use firmware::network::MAX_LAYERS;
use firmware::observation::{INPUTS, Observation};
use firmware::ring::MAX_PLACES;
use firmware::table::Provenance;
use firmware::units::{MAX_SUB_CHANNELS, SubChannels};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::policy::power_plan;
use host_sim::simulation::Simulation;
use host_sim::stream::Purpose;
use host_sim::thread_pool;
use kit::error::Result;
use kit::files::write_whole;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::path::PathBuf;
use trainer::actor_file;
use trainer::evaluate::compare;
use trainer::export::{Header, table_bytes};
use trainer::forms::{as_float, best_action};
use trainer::laboratory::actors::{ActorForm, Actors};
use trainer::network::perceptron::{Pass, Rows};
use trainer::network::{Layer, Network};
use trainer::quantise::quantise;

/// Worlds and slots that calibrate activations (chosen: about a quarter of a million observations of 20 vehicles).
const CALIBRATION_WORLDS: u64 = 32;
const CALIBRATION_SLOTS: u32 = 400;

/// A layer's weights and biases.
type LayerArrays<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f32>>);

/// Dense layers with ReLU between them, in f32.
#[pyclass(frozen, module = "freshlane._native")]
pub struct FloatNetwork {
    inner: Network,
}

#[pymethods]
impl FloatNetwork {
    /// Weights, float32 (outputs, inputs), and biases, float32 (outputs,), of each layer from the input on.
    #[new]
    fn new(layers: Vec<(PyReadonlyArray2<'_, f32>, PyReadonlyArray1<'_, f32>)>) -> PyResult<Self> {
        if layers.is_empty() || layers.len() > MAX_LAYERS {
            let expected = format!("1 to {MAX_LAYERS} layers");
            return Err(value_error(
                "network",
                format!("{} layers", layers.len()),
                expected,
            ));
        }
        let (mut widths, mut parameters) = (vec![INPUTS], Vec::new());
        for (index, (weights, biases)) in layers.iter().enumerate() {
            let &[outputs, columns] = weights.shape() else {
                continue;
            };
            let place = format!("network: layer {index}");
            let inputs = widths[index];
            if columns != inputs {
                return Err(value_error(place, format!("{columns} inputs"), inputs));
            }
            if biases.shape() != [outputs] {
                return Err(value_error(
                    place,
                    format!("{} biases", biases.shape()[0]),
                    outputs,
                ));
            }
            if index + 1 == layers.len() && outputs != ACTIONS {
                return Err(value_error(
                    place,
                    format!("{outputs} outputs"),
                    format!("{ACTIONS}, one an action"),
                ));
            }
            parameters.extend(weights.as_array().iter());
            parameters.extend(biases.as_array().iter());
            widths.push(outputs);
        }
        let inner = Network::new(&widths, parameters);
        Ok(Self { inner })
    }

    /// The network in a file of the trainer, which must be whole.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        let Actors { form, networks } = actor_file::read(&path).map_err(exception)?;
        let one = <[Network; 1]>::try_from(networks);
        match (form.observation, form.output, one) {
            (ObservationForm::Ring, OutputForm::Actions, Ok([inner])) => Ok(Self { inner }),
            (observation, output, _) => {
                let found = format!("actors that see {observation:?} and give {output:?}");
                let expected = "one network with the firmware's inputs and actions";
                Err(value_error(path.display(), found, expected))
            }
        }
    }

    /// Writes it as the trainer does.
    fn write(&self, path: PathBuf, vehicles: (u32, u32)) -> PyResult<()> {
        let bytes = self
            .actors(vehicles)
            .and_then(|actors| actor_file::to_bytes(&actors));
        bytes
            .and_then(|bytes| write_whole(&path, &bytes))
            .map_err(exception)
    }

    /// Weights, float32 (outputs, inputs), and biases, float32 (outputs,), of each layer from the input on.
    fn layers<'py>(&self, py: Python<'py>) -> PyResult<Vec<LayerArrays<'py>>> {
        let arrays = |layer: Layer<'_>| {
            let weights = PyArray1::from_slice(py, layer.weights);
            let weights = weights.reshape([layer.outputs, layer.inputs])?;
            Ok((weights, PyArray1::from_slice(py, layer.biases)))
        };
        self.inner.layers().map(arrays).collect()
    }

    /// Encoded observations of training worlds in which this network decides, int8 (rows, 22).
    fn calibration<'py>(
        &self,
        py: Python<'py>,
        scenario: &Scenario,
        seed: u64,
    ) -> PyResult<Bound<'py, PyArray2<i8>>> {
        let setting = Setting::new(scenario, None)?;
        let watched: Vec<Vec<[i8; INPUTS]>> = py.detach(|| {
            let worlds = (0..CALIBRATION_WORLDS).into_par_iter();
            worlds.map(|world| self.watch(&setting, seed, world)).collect()
        });
        let flat: Vec<i8> = watched.into_iter().flatten().flatten().collect();
        let shape = (flat.len() / INPUTS, INPUTS);
        let rows = numpy::ndarray::Array2::from_shape_vec(shape, flat);
        Ok(rows
            .map_err(|error| value_error("calibration", error, "rows of 20"))?
            .into_pyarray(py))
    }

    /// The firmware's table, its activations calibrated on these observations, int8 (rows, 22).
    fn quantise(
        &self,
        scenario: &Scenario,
        calibration: PyReadonlyArrayDyn<'_, i8>,
        max_vehicles: u16,
        seed: u64,
    ) -> PyResult<Table> {
        check_range("max_vehicles", max_vehicles.into(), 1, MAX_PLACES.into())?;
        let scenario = &scenario.inner;
        let sub_channels = scenario.radio.sub_channels;
        check_range(
            "radio.sub_channels",
            sub_channels.into(),
            1,
            MAX_SUB_CHANNELS as u64,
        )?;
        let header = Header {
            observation_form: ObservationForm::Ring,
            output_form: OutputForm::Actions,
            max_vehicles,
            max_sub_channels: SubChannels::new(sub_channels as usize).unwrap_or(SubChannels::ONE),
            required_sinr: scenario.radio.required_level(),
            power_plan: power_plan(scenario),
            // Trained elsewhere: no revision of these sources says how.
            provenance: Provenance {
                seed,
                revision: [0; 20],
                modified: false,
            },
        };
        let bytes = quantise(&self.inner, input_rows(&calibration)?.as_flattened(), None)
            .and_then(|quantised| table_bytes(&quantised, &header))
            .map_err(|error| exception(error.within("network")))?;
        Table::new("table", bytes)
    }

    /// On held-out worlds: the fraction of decisions on which float and int8 agree along the float network's trajectories, the
    /// mean age in ms with int8, and with float.
    #[allow(clippy::too_many_arguments, reason = "Python passes keywords")]
    #[pyo3(signature = (table, scenario, worlds, slots, warmup, seed, threads))]
    fn compare(
        &self,
        py: Python<'_>,
        table: &Table,
        scenario: &Scenario,
        worlds: u32,
        slots: u32,
        warmup: u32,
        seed: u64,
        threads: Option<u16>,
    ) -> PyResult<(f64, f64, f64)> {
        let extent = crate::evaluation::extent(worlds, slots, warmup, seed)?;
        let setting = Setting::new(scenario, None)?;
        let simulation = Simulation {
            scenario: &setting.scenario,
            source: setting.source.as_ref(),
            extent,
        };
        let table = table.parse()?;
        let pool = thread_pool(threads).map_err(exception)?;
        let vehicles = u32::from(table.max_vehicles());
        let actors = self.actors((1, vehicles)).map_err(exception)?;
        let compared = py.detach(|| pool.install(|| compare(&simulation, &actors, &[table])));
        let compared = compared.map_err(exception)?;
        Ok((
            compared.agreement,
            compared.quantised_age_ms,
            compared.float_age_ms,
        ))
    }
}

impl FloatNetwork {
    /// As the trainer has it: for cells with the fewest and the most vehicles.
    fn actors(&self, (min_vehicles, max_vehicles): (u32, u32)) -> Result<Actors> {
        let form = ActorForm {
            observation: ObservationForm::Ring,
            output: OutputForm::Actions,
            noise: 0.0,
            min_vehicles,
            max_vehicles,
        };
        let networks = vec![self.inner.clone()];
        let actors = Actors { form, networks };
        actors.check()?;
        Ok(actors)
    }

    /// What the network sees in a training world in which it decides.
    fn watch(&self, setting: &Setting, seed: u64, world: u64) -> Vec<[i8; INPUTS]> {
        let Setting { scenario, source } = setting;
        let worlds = world..world + 1;
        let mut environment = Environment::new(scenario, source.as_ref(), seed, Purpose::Training, worlds);
        let (required, plan) = (scenario.radio.required_level(), power_plan(scenario));
        let mut decisions = Decisions::new(1, environment.vehicles());
        let (mut inputs, mut pass) = (Vec::new(), Pass::default());
        for _ in 0..CALIBRATION_SLOTS {
            decisions.clear();
            let (first, mut observed) = (inputs.len(), Vec::new());
            for &vehicle in environment.present() {
                let Some(measurement) = environment.measurement(0, vehicle) else {
                    continue;
                };
                let observation = Observation::new(&measurement, environment.identity(0, vehicle));
                inputs.push(observation.encode(required));
                observed.push((vehicle, observation));
            }
            let floats: Vec<f32> = inputs[first..].iter().flat_map(as_float).collect();
            let _columns = self.inner.forward_batch(Rows::all(&floats, INPUTS), &mut pass);
            let scores = pass.output_lines();
            for ((vehicle, observation), scores) in observed.iter().zip(scores.chunks_exact(ACTIONS)) {
                decisions.set(0, *vehicle, plan.decision(best_action(scores), observation));
            }
            environment.step(&decisions);
        }
        inputs
    }
}
