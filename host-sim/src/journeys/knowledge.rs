//! What the base station believes of the roads: the usual until it hears otherwise, and the usual again when it hears nothing.

use super::roads::RoadMap;

/// Speed in m/s below which a road's time is not told apart (chosen: 1.8 km/h).
const SLOWEST_M_PER_S: f64 = 0.5;

/// A vehicle's word on its road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// The road.
    pub road: u32,
    /// Speed on it in m/s.
    pub speed_m_per_s: f64,
    /// When it was measured, in s.
    pub measured_s: f64,
}

/// How reports become beliefs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimator {
    /// Time over which one report weighs against those before it, in s of observed driving; 0 believes the last one.
    pub memory_s: f64,
    /// Of driving that one report tells, in s.
    pub report_s: f64,
    /// Time in which a belief falls to 1/e of the way back to the usual, in s.
    pub fade_s: f64,
}

/// Beliefs on all roads.
#[derive(Clone, Debug)]
pub struct Knowledge<'m> {
    map: &'m RoadMap,
    usual_speeds_m_per_s: &'m [f64],
    estimator: Estimator,
    /// Weight of a report against what was believed.
    weight: f64,
    /// By road: the smoothed speed, and when the last report was measured.
    estimates: Vec<(f64, f64)>,
    /// By road, at the time of the last look.
    times_s: Vec<f64>,
    looked_s: f64,
}

/// Time in s from end to end of a road at a speed.
pub fn road_time_s(length_m: f64, speed_m_per_s: f64) -> f64 {
    length_m / speed_m_per_s.max(SLOWEST_M_PER_S)
}

impl<'m> Knowledge<'m> {
    /// Believes the usual speed of every road.
    pub fn new(map: &'m RoadMap, usual_speeds_m_per_s: &'m [f64], estimator: Estimator) -> Self {
        let usual = usual_speeds_m_per_s.iter();
        let mut knowledge = Self {
            map,
            usual_speeds_m_per_s,
            estimator,
            weight: if estimator.memory_s > 0.0 {
                -libm::expm1(-estimator.report_s / estimator.memory_s)
            } else {
                1.0
            },
            estimates: usual.map(|&speed| (speed, f64::NEG_INFINITY)).collect(),
            times_s: vec![0.0; usual_speeds_m_per_s.len()],
            looked_s: 0.0,
        };
        knowledge.look(0.0);
        knowledge
    }

    /// The believed speed at a time: the estimate, and ever more the usual the longer nothing was heard.
    fn speed_m_per_s(&self, road: u32, time_s: f64) -> f64 {
        let (estimate, measured_s) = self.estimates[road as usize];
        let usual = self.usual_speeds_m_per_s[road as usize];
        usual + (estimate - usual) * libm::exp(-(time_s - measured_s) / self.estimator.fade_s)
    }

    /// Takes in a report; one that is older than the last has nothing to say.
    pub fn hear(&mut self, report: &Report) {
        let (_, last_s) = self.estimates[report.road as usize];
        if report.measured_s < last_s {
            return;
        }
        let before = self.speed_m_per_s(report.road, report.measured_s);
        let estimate = before + self.weight * (report.speed_m_per_s - before);
        self.estimates[report.road as usize] = (estimate, report.measured_s);
        // What was old when it came has faded as much as if it had come at once.
        let now_s = self.looked_s.max(report.measured_s);
        self.times_s[report.road as usize] = self.time_s(report.road, now_s);
    }

    fn time_s(&self, road: u32, time_s: f64) -> f64 {
        let length_m = self.map.roads()[road as usize].length_m;
        road_time_s(length_m, self.speed_m_per_s(road, time_s))
    }

    /// Lets beliefs fade until a time.
    pub fn look(&mut self, time_s: f64) {
        self.looked_s = time_s;
        for road in 0..self.times_s.len() {
            self.times_s[road] = self.time_s(road as u32, time_s);
        }
    }

    /// Believed time of every road in s, as of the last look and the reports since.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// Time since the last report of a road was measured, in s; infinite if there was none.
    pub fn age_s(&self, road: u32, time_s: f64) -> f64 {
        time_s - self.estimates[road as usize].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journeys::roads::Road;

    #[test]
    fn beliefs_follow_reports_and_fade() {
        let road = Road {
            from: 0,
            to: 1,
            length_m: 100.0,
            free_speed_m_per_s: 10.0,
            lanes: 1,
            capacity_veh_per_h: 1800.0,
            block: Some(0),
        };
        let map = RoadMap::new(vec![road], vec![(0.0, 0.0), (100.0, 0.0)]).unwrap();
        let usual = [10.0];
        let report = |measured_s| Report {
            road: 0,
            speed_m_per_s: 2.0,
            measured_s,
        };
        let at_once = Estimator {
            memory_s: 0.0,
            report_s: 2.0,
            fade_s: 300.0,
        };
        let mut knowledge = Knowledge::new(&map, &usual, at_once);
        assert_eq!(knowledge.times_s(), [10.0]);
        knowledge.hear(&report(5.0));
        assert_eq!(knowledge.times_s(), [50.0]);
        knowledge.look(305.0);
        let speed = 10.0 - 8.0 / std::f64::consts::E;
        assert!((knowledge.times_s()[0] - 100.0 / speed).abs() < 1e-9);
        // What comes late says nothing new.
        let before = knowledge.clone();
        knowledge.hear(&report(4.0));
        assert_eq!(knowledge.estimates, before.estimates);

        let slow = Estimator {
            memory_s: 20.0,
            ..at_once
        };
        let mut knowledge = Knowledge::new(&map, &usual, slow);
        for n in 0..10 {
            knowledge.hear(&report(2.0 * f64::from(n)));
        }
        // 20 s of driving take the belief to 1/e of the difference, a little less since it fades meanwhile.
        let (estimate, _) = knowledge.estimates[0];
        assert!((4.9..5.4).contains(&estimate), "{estimate}");
    }
}
