//! Ticks at round numbers, and the way from a value to a share of the axis.

use super::Scale;

/// About how many labelled ticks an axis should have.
const WANTED_TICKS: f64 = 6.0;

/// Decades up to which a logarithmic axis also labels 2 and 5 of each.
const DENSE_DECADES: f64 = 2.2;

/// A linear axis begins at zero if its least value is below this share of the greatest.
const ZERO_SHARE: f64 = 0.5;

/// A place on an axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub value: f64,
    /// A tick without number is a grid line only.
    pub label: Option<String>,
}

/// An axis' range and its ticks, in ascending order.
#[derive(Debug, Clone)]
pub(super) struct Ticks {
    scale: Scale,
    lower: f64,
    upper: f64,
    pub ticks: Vec<Tick>,
}

impl Ticks {
    /// A range that ends at ticks and holds all values. Values fit the scale; without any, the axis is 0 to 1.
    pub fn around(scale: Scale, values: impl IntoIterator<Item = f64>) -> Self {
        let (least, greatest) = extremes(values);
        match scale {
            Scale::Linear => Self::linear(least, greatest, true),
            Scale::Logarithmic => Self::logarithmic(least, greatest),
        }
    }

    /// A range that ends at the extreme values themselves, as suits an independent variable.
    pub fn tight(scale: Scale, values: impl IntoIterator<Item = f64>) -> Self {
        let (least, greatest) = extremes(values);
        let whole = match scale {
            Scale::Linear => Self::linear(least, greatest, false),
            Scale::Logarithmic => Self::logarithmic(least, greatest),
        };
        if least >= greatest {
            return whole;
        }
        let is_inside = |tick: &Tick| least <= tick.value && tick.value <= greatest;
        Self {
            lower: least,
            upper: greatest,
            ticks: whole.ticks.into_iter().filter(is_inside).collect(),
            scale,
        }
    }

    /// A value's share of the axis: 0 at its lower end, 1 at its upper.
    pub fn share(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.lower) / (self.upper - self.lower),
            Scale::Logarithmic => libm::log(value / self.lower) / libm::log(self.upper / self.lower),
        }
    }

    /// The longest number on the axis.
    pub fn longest_label(&self) -> &str {
        let labels = self.ticks.iter().filter_map(|tick| tick.label.as_deref());
        labels.max_by_key(|label| label.chars().count()).unwrap_or("")
    }

    fn linear(least: f64, greatest: f64, may_begin_at_zero: bool) -> Self {
        let from_zero = may_begin_at_zero && least >= 0.0 && least < ZERO_SHARE * greatest;
        let least = if from_zero { 0.0 } else { least };
        let (least, greatest) = if least < greatest {
            (least, greatest)
        } else {
            let half = if least == 0.0 { 0.5 } else { 0.1 * least.abs() };
            (least - half, greatest + half)
        };
        // Halved first, so that no finite range overflows.
        let step = round_step((greatest / WANTED_TICKS) - (least / WANTED_TICKS));
        let (first, last) = ((least / step).floor(), (greatest / step).ceil());
        let decimals = decimals_of(step);
        let mut ticks = Vec::new();
        let mut count = first;
        while count <= last {
            // From the count, not by adding up, so that no rounding gathers. Plus zero, so that none is -0.
            let value = count * step + 0.0;
            ticks.push(Tick {
                value,
                label: Some(number(value, decimals)),
            });
            count += 1.0;
        }
        Self {
            scale: Scale::Linear,
            lower: first * step,
            upper: last * step,
            ticks,
        }
    }

    fn logarithmic(least: f64, greatest: f64) -> Self {
        let power = |exponent: i32| libm::pow(10.0, f64::from(exponent));
        // Decades are few: a finite f64 has some 600.
        let first_decade = libm::floor(libm::log10(least)) as i32;
        let last_decade = libm::ceil(libm::log10(greatest)) as i32;
        let round: Vec<(f64, bool)> = (first_decade..=last_decade)
            .flat_map(|decade| [1.0, 2.0, 5.0].map(|digit| (digit * power(decade), digit == 1.0)))
            .collect();
        let begin = round.iter().rposition(|(value, _)| *value <= least).unwrap_or(0);
        let end = round
            .iter()
            .position(|(value, _)| *value >= greatest && *value > round[begin].0)
            .unwrap_or(round.len() - 1);
        let used = &round[begin..=end];
        let (lower, upper) = (round[begin].0, round[end].0);
        let dense = libm::log10(upper / lower) <= DENSE_DECADES;
        let every = ((last_decade - first_decade) / 8).max(1);
        let ticks = used.iter().map(|&(value, whole_decade)| {
            let decade = libm::round(libm::log10(value)) as i32;
            let labelled = dense || (whole_decade && decade.rem_euclid(every) == 0);
            Tick {
                value,
                label: labelled.then(|| number(value, decimals_of(value))),
            }
        });
        Self {
            scale: Scale::Logarithmic,
            lower,
            upper,
            ticks: ticks.collect(),
        }
    }
}

fn extremes(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (least, greatest) = values
        .into_iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), value| {
            (value.min(least), value.max(greatest))
        });
    if least <= greatest {
        (least, greatest)
    } else {
        (0.0, 1.0)
    }
}

/// The round number (1, 2, 2.5 or 5 times a power of ten) that is nearest above `rough`.
fn round_step(rough: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let round = [1.0, 2.0, 2.5, 5.0].map(|digit| digit * power);
    round
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(10.0 * power)
}

/// Decimals that show a number of at most two significant digits.
fn decimals_of(number: f64) -> usize {
    (0..12)
        .find(|decimals| {
            let scaled = number * libm::pow(10.0, f64::from(*decimals));
            (scaled - scaled.round()).abs() < 1e-6 * scaled.abs()
        })
        .unwrap_or(12) as usize
}

/// A tick's number; very large and very small ones in powers of ten.
fn number(value: f64, decimals: usize) -> String {
    if value != 0.0 && !(1e-4..1e7).contains(&value.abs()) {
        let text = format!("{value:.2e}");
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return format!(
            "{}e{exponent}",
            mantissa.trim_end_matches('0').trim_end_matches('.')
        );
    }
    format!("{value:.decimals$}")
}
