//! The paper's Table I as checked configuration.
//!
//! A scenario is a preset, then a file that may change some of its keys, then single `KEY=VALUE` settings.

mod source;

use firmware::units::{Dbm, Level};
use kit::error::{Error, Result};
use kit::keys;

pub use source::{EXPLAIN, Preset, ScenarioSource, nearest_key};

keys! {
    /// A checked scenario.
    pub struct Scenario {
        /// Who is in the cell, and where its antenna stands.
        pub cell: CellScenario,
        /// Link budget and channel. Levels and powers stay within what units express, -128 to 128 dB.
        pub radio: RadioScenario,
        /// The urban grid and how vehicles drive on it.
        pub mobility: MobilityScenario,
        /// How fast fading changes, and how alike it is on neighbouring sub-channels.
        pub fading: FadingScenario,
        /// How well units and base station know the gains.
        pub knowledge: KnowledgeScenario,
        /// What gets lost or late on the way back to the vehicles.
        pub feedback: FeedbackScenario,
        /// When a transmission is received.
        pub reception: ReceptionScenario,
        /// Bursts of interference from other cells.
        pub neighbours: NeighbourScenario,
        /// What the base station tells its vehicles, and how late.
        pub broadcast: BroadcastScenario,
        /// Parameters of the simple policies.
        pub baselines: BaselineScenario,
        /// The roads between the crossings of the grid, and what age costs them.
        pub traffic: TrafficScenario,
        /// The closed loop from slot to street: how often routes are planned, and what happens on the road meanwhile.
        pub planning: PlanningScenario,
    }

    /// The section `cell`.
    pub struct CellScenario {
        /// Vehicles in the cell.
        #[key(range = 1.0..=10_000.0, unit = "vehicles", source = "Table I")]
        pub vehicles: u32,
        /// Probability that a vehicle leaves in a slot, and a new one comes elsewhere on the grid.
        #[key(range = 0.0..=0.5, unit = "1/slot", source = "chosen, the paper has none")]
        pub replacement_probability: f64,
        /// The base station's place along x.
        #[key(range = -1e8..=1e8, unit = "m", source = "the grid's centre")]
        pub base_station_x_m: f64,
        /// The base station's place along y.
        #[key(range = -1e8..=1e8, unit = "m", source = "the grid's centre")]
        pub base_station_y_m: f64,
        /// Height of the base station's antenna.
        #[key(range = 0.0..=1e6, unit = "m", source = "Table I")]
        pub base_station_height_m: f64,
        /// Height of a vehicle's antenna.
        #[key(range = 0.0..=1e6, unit = "m", source = "Table I")]
        pub vehicle_height_m: f64,
    }

    /// The section `radio`.
    pub struct RadioScenario {
        /// Carrier frequency, which scales the path loss by 21 log10(f / 2 GHz).
        #[key(range = 1e-6..=1e6, unit = "GHz", source = "Table I, 3GPP TR 36.942 4.5.2")]
        pub carrier_ghz: f64,
        /// Sub-channels to the base station. Units, and so actor and clock, know up to 16; the shipped table serves up to 8.
        #[key(range = 1.0..=200.0, unit = "sub-channels", source = "Table I")]
        pub sub_channels: u32,
        /// Bandwidth of a sub-channel.
        #[key(range = 1e-6..=1e6, unit = "kHz", source = "Table I")]
        pub bandwidth_khz: f64,
        /// C_min over the bandwidth, the rate that a report needs: 540 kbit/s here, at exactly Shannon's rate, some 5 dB less than a real
        /// code needs. Below 1, two vehicles could succeed on one sub-channel at once.
        #[key(range = 1.0..=20.0, unit = "bit/s/Hz", source = "the group's earlier work, the paper has none")]
        pub min_spectral_efficiency: f64,
        /// Full power of a vehicle.
        #[key(range = -100.0..=100.0, unit = "dBm", source = "Table I")]
        pub max_power_dbm: f64,
        /// Noise on a sub-channel: with the noise figure, 7.4 dB more than 180 kHz have.
        #[key(range = -250.0..=100.0, unit = "dBm", source = "Table I")]
        pub noise_power_dbm: f64,
        /// Gain of a vehicle's antenna.
        #[key(range = -100.0..=100.0, unit = "dBi", source = "Table I")]
        pub vehicle_antenna_gain_dbi: f64,
        /// Gain of the base station's antenna.
        #[key(range = -100.0..=100.0, unit = "dBi", source = "Table I")]
        pub base_station_antenna_gain_dbi: f64,
        /// Noise that the base station's receiver adds.
        #[key(range = 0.0..=100.0, unit = "dB", source = "Table I")]
        pub base_station_noise_figure_db: f64,
        /// Noise that a vehicle's receiver adds. Nothing depends on it: the downlink is taken as free of errors.
        #[key(range = 0.0..=100.0, unit = "dB", source = "Table I")]
        pub vehicle_noise_figure_db: f64,
        /// Path loss at 1 km.
        #[key(range = 0.0..=500.0, unit = "dB", source = "Table I")]
        pub path_loss_intercept_db: f64,
        /// Path loss for each decade of distance.
        #[key(range = 0.0..=100.0, unit = "dB", source = "Table I")]
        pub path_loss_slope_db: f64,
        /// Standard deviation of log-normal shadowing.
        #[key(range = 0.0..=100.0, unit = "dB", source = "Table I")]
        pub shadowing_deviation_db: f64,
        /// Distance on which the correlation of shadowing falls to 1/e.
        #[key(range = 1e-6..=1e6, unit = "m", source = "Table I")]
        pub shadowing_decorrelation_m: f64,
        /// Time between updates of places, path loss and shadowing. Fast fading is new in every slot.
        #[key(range = 1.0..=100_000.0, unit = "slots", source = "Table I")]
        pub slow_update_slots: u32,
    }

    /// The section `mobility`.
    pub struct MobilityScenario {
        /// Blocks along x.
        #[key(range = 1.0..=100.0, unit = "blocks", source = "3GPP TR 36.885 A.1.2")]
        pub blocks_x: u32,
        /// Blocks along y.
        #[key(range = 1.0..=100.0, unit = "blocks", source = "3GPP TR 36.885 A.1.2")]
        pub blocks_y: u32,
        /// Length of a block along x.
        #[key(range = 1e-6..=1e6, unit = "m", source = "3GPP TR 36.885 A.1.2")]
        pub block_x_m: f64,
        /// Length of a block along y.
        #[key(range = 1e-6..=1e6, unit = "m", source = "3GPP TR 36.885 A.1.2")]
        pub block_y_m: f64,
        /// Lanes of a road in each direction.
        #[key(range = 1.0..=8.0, unit = "lanes", source = "3GPP TR 36.885 A.1.2")]
        pub lanes_per_direction: u32,
        /// Width of a lane.
        #[key(range = 1e-6..=1e6, unit = "m", source = "3GPP TR 36.885 A.1.2")]
        pub lane_width_m: f64,
        /// Speed of the slowest vehicle.
        #[key(range = 0.0..=100.0, unit = "m/s", source = "Table I")]
        pub min_speed_m_per_s: f64,
        /// Speed of the fastest vehicle.
        #[key(range = 0.0..=100.0, unit = "m/s", source = "Table I")]
        pub max_speed_m_per_s: f64,
        /// Where a vehicle on the grid makes up its mind whether to turn.
        #[key(source = "per-lane in the companion code, per-crossing in 3GPP TR 36.885 A.1.2")]
        pub turns: Turns,
        /// Probability that a vehicle turns into a lane that it crosses, where turns are per lane. With two lanes in each direction
        /// 59 % leave a crossing to the right, 24 % straight on, 11 % to the left, and 6 % where they came from.
        #[key(range = 0.0..=1.0, source = "3GPP TR 36.885 A.1.2 as the companion code reads it")]
        pub turn_probability: f64,
        /// Share of vehicles that turn left at a crossing, where turns are per crossing. Where a way does not lead on, the
        /// others take its share.
        #[key(range = 0.0..=1.0, source = "3GPP TR 36.885 A.1.2, TR 37.885")]
        pub left_turn_share: f64,
        /// Share that turn right; the rest go straight on.
        #[key(range = 0.0..=1.0, source = "3GPP TR 36.885 A.1.2, TR 37.885")]
        pub right_turn_share: f64,
        /// Cycle of the fixed-time signals at the crossings of the grid, before which vehicles queue; 0 for none.
        #[key(range = 0.0..=600.0, unit = "s", source = "0 in the paper, 60 to 120 are usual")]
        pub signal_cycle_s: f64,
        /// Share of the cycle in which a street has red. Above 0.5, both streets have at times.
        #[key(range = 0.5..=0.99, source = "chosen, the paper has none")]
        pub signal_red_share: f64,
        /// From one vehicle of a queue to the next, and the least distance on a lane with signals.
        #[key(range = 0.0..=1000.0, unit = "m", source = "chosen: 5 m of vehicle, 2.5 m of gap")]
        pub queue_spacing_m: f64,
        /// Share of the vehicles on the grid that stand from the start, as in a jam or a depot. Without
        /// `fading.follows_speed` it changes places and shadowing alone.
        #[key(range = 0.0..=1.0, source = "chosen, the paper has none")]
        pub standing_share: f64,
    }

    /// The section `fading`.
    pub struct FadingScenario {
        /// Whether Rayleigh fading is a sum of sinusoids at each vehicle's own Doppler shift, instead of new in every slot.
        #[key(source = "false in the paper; Clarke 1968, Jakes 1974")]
        pub follows_speed: bool,
        /// Largest Doppler shift of a vehicle that stands, from what moves around it.
        #[key(range = 0.0..=500.0, unit = "Hz", source = "chosen, the paper has none")]
        pub residual_doppler_hz: f64,
        /// Correlation of the complex amplitudes on neighbouring sub-channels.
        #[key(range = 0.0..=1.0, source = "0 in the paper")]
        pub sub_channel_correlation: f64,
    }

    /// The section `knowledge`.
    pub struct KnowledgeScenario {
        /// Age of the gains that units and base station know.
        #[key(range = 0.0..=99.0, unit = "slots", source = "0 in the paper")]
        pub gain_delay_slots: u32,
        /// Standard deviation of the error of each known gain, a normal one that is new in every slot.
        #[key(range = 0.0..=50.0, unit = "dB", source = "0 in the paper")]
        pub gain_error_db: f64,
    }

    /// The section `feedback`.
    pub struct FeedbackScenario {
        /// Slots that an acknowledgement comes later than before the next slot. In LTE it is 4 slots under way.
        #[key(range = 0.0..=99.0, unit = "slots", source = "0 in the paper; 3GPP TS 36.213 8.3: n + 4")]
        pub acknowledgement_delay_slots: u32,
        /// Share of acknowledgements that are lost.
        #[key(range = 0.0..=1.0, source = "0 in the paper")]
        pub acknowledgement_loss: f64,
        /// Share of a vehicle's slots in which it does not hear the broadcast: it goes on with the last one that it heard. The
        /// first comes with its association.
        #[key(range = 0.0..=1.0, source = "0 in the paper")]
        pub broadcast_loss: f64,
        /// Share of a unit's slots in which its modem measures nothing.
        #[key(range = 0.0..=1.0, source = "0 in the paper")]
        pub measurement_loss: f64,
        /// Share of vehicles to which the place does not get through that the association gives them.
        #[key(range = 0.0..=1.0, source = "chosen, the paper has none")]
        pub place_loss: f64,
        /// Share of a scheduler's grants that are lost.
        #[key(range = 0.0..=1.0, source = "chosen, the paper has none")]
        pub grant_loss: f64,
    }

    /// The section `reception`.
    pub struct ReceptionScenario {
        /// Width of the logistic curve by which the probability of reception goes over the required SINR: 73 % are received one
        /// width above it.
        #[key(range = 0.0..=20.0, unit = "dB", source = "0 in the paper, a step")]
        pub block_error_width_db: f64,
    }

    /// The section `neighbours`.
    pub struct NeighbourScenario {
        /// What other cells raise the noise by while they interfere on a sub-channel.
        #[key(range = 0.0..=60.0, unit = "dB", source = "0 in the paper, a cell without neighbours")]
        pub noise_rise_db: f64,
        /// Share of slots in which they interfere.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub duty: f64,
        /// Mean length of their interference.
        #[key(range = 1.0..=1e6, unit = "slots", source = "chosen")]
        pub burst_slots: f64,
    }

    /// The section `broadcast`.
    pub struct BroadcastScenario {
        /// How long before a slot the base station decides who is called to contend in it.
        #[key(range = 0.0..=10_000.0, unit = "slots", source = "chosen")]
        pub call_delay_slots: u32,
        /// Delay until a ring that shrinks is announced. One that grows is announced at once.
        #[key(range = 0.0..=10_000.0, unit = "slots", source = "chosen")]
        pub shrink_delay_slots: u32,
    }

    /// The section `baselines`.
    pub struct BaselineScenario {
        /// Transmissions of slotted ALOHA per sub-channel and slot: probability 0.2 at 20 vehicles.
        #[key(range = 0.0..=1e6, unit = "transmissions/slot", source = "best found")]
        pub aloha_load: f64,
        /// Age threshold over vehicles per sub-channel: 10 slots at 20 vehicles.
        #[key(range = 0.0..=1e6, unit = "slots", source = "best found")]
        pub age_threshold_load: f64,
        /// Probability that a vehicle above the threshold sends.
        #[key(range = 0.0..=1.0, source = "best found")]
        pub age_threshold_probability: f64,
        /// How many slots ahead dynamic grants are decided.
        #[key(range = 0.0..=99.0, unit = "slots", source = "3GPP TS 36.213 8: n + 4")]
        pub grant_delay_slots: u32,
        /// Reservation period of semi-persistent scheduling over vehicles per sub-channel: 10 slots at 20 vehicles.
        #[key(range = 0.1..=20.0, unit = "slots", source = "best found")]
        pub sps_period_load: f64,
        /// Probability that a vehicle keeps its resource when its count of reservations is used up.
        #[key(range = 0.0..=0.8, source = "3GPP TS 36.331 6.3.8: 0 to 0.8, 0.8 chosen")]
        pub sps_keep_probability: f64,
    }

    /// The section `traffic`.
    pub struct TrafficScenario {
        /// Travel time on an empty block along x.
        #[key(range = 1e-6..=1e6, unit = "s", source = "Table I")]
        pub free_flow_time_x_s: f64,
        /// Travel time on an empty block along y.
        #[key(range = 1e-6..=1e6, unit = "s", source = "Table I")]
        pub free_flow_time_y_s: f64,
        /// Capacity of a road.
        #[key(range = 1e-6..=1e6, unit = "veh/h", source = "Table I")]
        pub capacity_veh_per_h: f64,
        /// Trips for each of the 16 x 15 pairs of crossings.
        #[key(range = 0.0..=1e6, unit = "veh/h", source = "Table I")]
        pub trips_per_pair_veh_per_h: f64,
        /// Factor of the volume-delay function, alpha_u in the paper.
        #[key(range = 0.0..=1e6, source = "Table I")]
        pub bpr_factor: f64,
        /// Power of the volume-delay function, beta_u in the paper.
        #[key(range = 0.0..=100.0, source = "Table I")]
        pub bpr_power: f64,
        /// Capacity that is lost at the largest age, delta m in the paper.
        #[key(range = 0.0..=1e6, unit = "veh/h", source = "one of several in the paper")]
        pub max_capacity_error_veh_per_h: f64,
    }

    /// The section `planning`.
    pub struct PlanningScenario {
        /// What a lane of the grid's roads carries in the loop, of which each direction has `mobility.lanes_per_direction`.
        #[key(range = 1.0..=1e5, unit = "veh/h", source = "chosen, a customary saturation flow")]
        pub lane_capacity_veh_per_h: f64,
        /// Trips for each pair of the grid's crossings in the loop.
        #[key(range = 0.0..=1e6, unit = "veh/h", source = "chosen: without incidents nobody queues")]
        pub trips_per_pair_veh_per_h: f64,
        /// Factor on the trips of the grid or of a loaded network.
        #[key(range = 0.0..=1e6, source = "chosen")]
        pub demand_factor: f64,
        /// Time for which vehicles set out.
        #[key(range = 60.0..=86_400.0, unit = "s", source = "chosen")]
        pub horizon_s: f64,
        /// Trips that set out before do not count.
        #[key(range = 0.0..=86_400.0, unit = "s", source = "chosen")]
        pub warmup_s: f64,
        /// Time between two looks at the roads: connected vehicles have a report ready, the base station's beliefs fade.
        #[key(range = 0.1..=60.0, unit = "s", source = "chosen")]
        pub look_s: f64,
        /// Mean time from one incident's end to the next one's start, on each block.
        #[key(range = 1.0..=1e9, unit = "s", source = "chosen")]
        pub incident_interval_s: f64,
        /// Mean time that an incident lasts.
        #[key(range = 1.0..=1e6, unit = "s", source = "chosen")]
        pub incident_duration_s: f64,
        /// Share of both directions' capacity that an incident takes; vehicles slow down to the speed at which the rest flows.
        #[key(range = 0.0..=0.99, source = "chosen")]
        pub incident_capacity_loss: f64,
        /// Share of vehicles that are connected and report.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub connected_share: f64,
        /// Share of vehicles that follow advice, connected or not.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub obeying_share: f64,
        /// Observed driving over which a report weighs against those before it: what the detector of slow roads needs.
        #[key(range = 0.0..=3600.0, unit = "s", source = "chosen")]
        pub detector_memory_s: f64,
        /// Time in which a belief falls to 1/e of the way back to the usual when nothing is heard of a road.
        #[key(range = 1.0..=1e9, unit = "s", source = "chosen")]
        pub belief_fade_s: f64,
        /// Time between two pieces of advice to a vehicle on its way.
        #[key(range = 1.0..=86_400.0, unit = "s", source = "chosen")]
        pub advice_s: f64,
        /// A vehicle takes the believed time of a road for up to so large a share longer or shorter, so that not all take the
        /// same way out.
        #[key(range = 0.0..=0.99, source = "chosen")]
        pub choice_spread: f64,
        /// Share of the time ahead that another way must save before a vehicle takes it.
        #[key(range = 0.0..=0.99, source = "chosen")]
        pub choice_gain: f64,
        /// Distance between the base stations of a loaded network, on a square lattice over it.
        #[key(range = 1.0..=1e6, unit = "m", source = "chosen: the paper's cell")]
        pub station_spacing_m: f64,
        /// Time between two sampled seconds of radio.
        #[key(range = 1.0..=86_400.0, unit = "s", source = "chosen")]
        pub radio_sample_s: f64,
    }
}

kit::choices! {
    /// Where vehicles on the grid turn.
    pub enum Turns {
        /// At each lane that they cross, with one probability.
        PerLane = "per-lane",
        /// Once at each crossing, with a share for each way.
        PerCrossing = "per-crossing",
    }
}

/// Exact, by definition of the metre.
const SPEED_OF_LIGHT_M_PER_S: f64 = 299_792_458.0;

impl RadioScenario {
    /// Signal-to-interference-and-noise ratio from which a transmission carries C_min: 2^(C_min/W) - 1 (paper eq. 2).
    pub fn required_sinr(&self) -> f64 {
        libm::exp2(self.min_spectral_efficiency) - 1.0
    }

    /// [`RadioScenario::required_sinr`] as units know it, rounded up to their next step.
    pub fn required_level(&self) -> Level {
        Level::saturating_from_num(libm::ceil(2560.0 * libm::log10(self.required_sinr())) / 256.0)
    }

    /// [`RadioScenario::max_power_dbm`] as units know it, rounded down so that no limit is exceeded.
    pub fn max_power(&self) -> Dbm {
        Dbm::from_bits(libm::floor(self.max_power_dbm * 256.0) as i16)
    }

    /// The Doppler shift at a speed, in Hz.
    pub fn doppler_hz(&self, speed_m_per_s: f64) -> f64 {
        speed_m_per_s * self.carrier_ghz * 1e9 / SPEED_OF_LIGHT_M_PER_S
    }

    /// C_min in kbit/s.
    pub fn min_rate_kbit_per_s(&self) -> f64 {
        self.min_spectral_efficiency * self.bandwidth_khz
    }

    /// Level over noise at the base station of a vehicle at full power, without path loss, in dB.
    pub fn budget_db(&self) -> f64 {
        self.max_power_dbm + self.vehicle_antenna_gain_dbi + self.base_station_antenna_gain_dbi
            - self.base_station_noise_figure_db
            - self.noise_power_dbm
    }
}

impl Scenario {
    /// Checks what two keys say together.
    ///
    /// # Errors
    /// The first key, as `section.key`, that does not go with another.
    pub fn check(&self) -> Result<()> {
        let Self {
            mobility,
            fading,
            neighbours,
            traffic,
            planning,
            ..
        } = self;
        let street_half_width = mobility.lane_width_m * f64::from(mobility.lanes_per_direction);
        within(
            "mobility.lane_width_m times lanes_per_direction",
            street_half_width,
            0.0,
            mobility.block_x_m.min(mobility.block_y_m) / 2.0,
            "at most half of block_x_m and of block_y_m",
        )?;
        within(
            "mobility.max_speed_m_per_s",
            mobility.max_speed_m_per_s,
            mobility.min_speed_m_per_s,
            f64::INFINITY,
            "at least mobility.min_speed_m_per_s",
        )?;
        within(
            "mobility.right_turn_share",
            mobility.right_turn_share,
            0.0,
            // Shares as people write them add up to 1 but for the last bits.
            1.0 - mobility.left_turn_share + 1e-9,
            "at most 1 less mobility.left_turn_share",
        )?;
        if neighbours.duty < 1.0 {
            within(
                "neighbours.duty",
                neighbours.duty,
                0.0,
                neighbours.burst_slots / (neighbours.burst_slots + 1.0),
                "1, or at most burst_slots / (burst_slots + 1), since quiet lasts a slot at least",
            )?;
        }
        within(
            "planning.warmup_s",
            planning.warmup_s,
            0.0,
            planning.horizon_s.next_down(),
            "less than planning.horizon_s",
        )?;
        within(
            "planning.radio_sample_s",
            planning.radio_sample_s,
            0.0,
            planning.horizon_s,
            "at most planning.horizon_s",
        )?;
        if !fading.follows_speed {
            within(
                "fading.residual_doppler_hz",
                fading.residual_doppler_hz,
                0.0,
                0.0,
                "0 without fading.follows_speed",
            )?;
        }
        within(
            "traffic.max_capacity_error_veh_per_h",
            traffic.max_capacity_error_veh_per_h,
            0.0,
            traffic.capacity_veh_per_h.next_down(),
            "less than traffic.capacity_veh_per_h",
        )
    }
}

fn within(key: &str, found: f64, least: f64, most: f64, expected: &str) -> Result<()> {
    if (least..=most).contains(&found) {
        Ok(())
    } else {
        Err(Error::input(key, found, expected))
    }
}
