//! Who is received in a slot: interference, signal-to-interference-and-noise ratio, success (paper eqs. 2 and 3).

use firmware::decision::Decision;
use firmware::units::SUB_CHANNELS;

/// One transmission as the base station receives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transmission {
    /// Whose.
    pub vehicle: usize,
    /// Where.
    pub sub_channel: usize,
    /// Received power over noise power.
    pub received: f64,
}

/// What happened in a slot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SlotOutcome {
    /// All transmissions.
    pub transmissions: Vec<Transmission>,
    /// The vehicles that were received.
    pub received: Vec<usize>,
}

impl SlotOutcome {
    /// Evaluates a slot's decisions; buffers are reused.
    ///
    /// `gain_db(vehicle)` is the level over noise at full power, `max_power_dbm` that power. A transmission is received if its
    /// ratio of signal to interference and noise reaches `required_sinr`, that is if its Shannon rate reaches C_min.
    pub fn evaluate<'a>(
        &mut self,
        decisions: impl Iterator<Item = (usize, Decision)>,
        gain_db: impl Fn(usize) -> &'a [f32; SUB_CHANNELS],
        max_power_dbm: f64,
        required_sinr: f64,
    ) {
        self.transmissions.clear();
        self.received.clear();
        for (vehicle, decision) in decisions {
            if let Decision::Transmit { sub_channel, power } = decision {
                let sub_channel = sub_channel.index();
                let reduction_db = max_power_dbm - power.value().to_num::<f64>();
                let level_db = f64::from(gain_db(vehicle)[sub_channel]) - reduction_db;
                let received = libm::exp10(level_db / 10.0);
                self.transmissions.push(Transmission {
                    vehicle,
                    sub_channel,
                    received,
                });
            }
        }
        for (index, transmission) in self.transmissions.iter().enumerate() {
            let interference = self.interference(transmission.sub_channel, Some(index));
            if transmission.received >= required_sinr * (1.0 + interference) {
                self.received.push(transmission.vehicle);
            }
        }
    }

    /// Power over noise on a sub-channel, without one of the transmissions. Sums the others, so that a strong one does not
    /// cancel away a weak one.
    pub fn interference(&self, sub_channel: usize, without: Option<usize>) -> f64 {
        let others = self.transmissions.iter().enumerate();
        others
            .filter(|(index, other)| other.sub_channel == sub_channel && Some(*index) != without)
            .map(|(_, other)| other.received)
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware::units::{Dbm, SubChannel};

    fn send(sub_channel: u8, power_dbm: f64) -> Decision {
        let power = Dbm::from_bits((power_dbm * 256.0) as i16);
        Decision::Transmit {
            sub_channel: SubChannel::new(sub_channel).unwrap(),
            power,
        }
    }

    fn received(gains: &[[f32; 3]], decisions: &[Decision]) -> Vec<usize> {
        let mut outcome = SlotOutcome::default();
        outcome.evaluate(
            decisions.iter().copied().enumerate(),
            |vehicle| &gains[vehicle],
            30.0,
            7.0,
        );
        outcome.received
    }

    #[test]
    fn sinr_by_hand() {
        // Alone: 8.45 dB is just enough (SINR 7), 8.4 dB is not.
        assert_eq!(received(&[[8.46, 0.0, 0.0]], &[send(0, 30.0)]), [0]);
        assert!(received(&[[8.44, 0.0, 0.0]], &[send(0, 30.0)]).is_empty());
        // 3 dB less power needs 3 dB more gain.
        assert!(received(&[[11.4, 0.0, 0.0]], &[send(0, 27.0)]).is_empty());
        assert_eq!(received(&[[11.5, 0.0, 0.0]], &[send(0, 27.0)]), [0]);
        // Two at 30 and 20 dB on one sub-channel: 1000 / (1 + 100) = 9.9, so the stronger is captured.
        assert_eq!(
            received(
                &[[30.0, 0.0, 0.0], [20.0, 0.0, 0.0]],
                &[send(0, 30.0), send(0, 30.0)]
            ),
            [0]
        );
        // At 30 and 22 dB: 1000 / 159.5 = 6.3, so neither.
        assert!(
            received(
                &[[30.0, 0.0, 0.0], [22.0, 0.0, 0.0]],
                &[send(0, 30.0), send(0, 30.0)]
            )
            .is_empty()
        );
        // On two sub-channels both.
        assert_eq!(
            received(
                &[[30.0, 0.0, 0.0], [0.0, 22.0, 0.0]],
                &[send(0, 30.0), send(1, 30.0)]
            ),
            [0, 1]
        );
    }
}
