//! Units of length and speed that network files come in.

use kit::choice::Choice;

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// Metres.
    Metre,
    /// Kilometres.
    Kilometre,
    /// International feet.
    Foot,
    /// Statute miles.
    Mile,
}

/// A unit of speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speed {
    /// Kilometres an hour.
    KilometrePerHour,
    /// Miles an hour.
    MilePerHour,
    /// Metres a second.
    MetrePerSecond,
    /// Feet a second.
    FootPerSecond,
}

impl Length {
    /// Metres of one unit.
    pub const fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Kilometre => 1_000.0,
            Self::Foot => 0.304_8,
            Self::Mile => 1_609.344,
        }
    }

    /// The unit of a word in a file, in any spelling that is in use.
    pub fn of_word(word: &str) -> Option<Self> {
        Some(match word.trim().to_ascii_lowercase().as_str() {
            "m" | "meter" | "meters" | "metre" | "metres" => Self::Metre,
            "km" | "kilometer" | "kilometers" | "kilometre" | "kilometres" => Self::Kilometre,
            "ft" | "foot" | "feet" => Self::Foot,
            "mi" | "mile" | "miles" => Self::Mile,
            _ => return None,
        })
    }

    /// The speed that usually goes with it: what signs at the road show.
    pub const fn usual_speed(self) -> Speed {
        match self {
            Self::Metre | Self::Kilometre => Speed::KilometrePerHour,
            Self::Foot | Self::Mile => Speed::MilePerHour,
        }
    }
}

impl Speed {
    /// Metres a second of one unit.
    pub const fn metres_per_second(self) -> f64 {
        match self {
            Self::KilometrePerHour => 1.0 / 3.6,
            Self::MilePerHour => 1_609.344 / 3_600.0,
            Self::MetrePerSecond => 1.0,
            Self::FootPerSecond => 0.304_8,
        }
    }

    /// The unit of a word in a file, in any spelling that is in use.
    pub fn of_word(word: &str) -> Option<Self> {
        let word: String = word.to_ascii_lowercase().split_whitespace().collect();
        Some(match word.as_str() {
            "kph" | "kmh" | "km/h" | "kmph" | "km/hr" | "kilometersperhour" | "kilometresperhour" => {
                Self::KilometrePerHour
            }
            "mph" | "mi/h" | "mile/h" | "miles/h" | "mi/hr" | "milesperhour" => Self::MilePerHour,
            "m/s" | "mps" | "meterspersecond" | "metrespersecond" => Self::MetrePerSecond,
            "ft/s" | "fps" | "feetpersecond" => Self::FootPerSecond,
            _ => return None,
        })
    }

    /// The unit of length that it counts an hour of, if it does: a length in it, divided by such a speed, gives hours.
    pub const fn length_per_hour(self) -> Option<Length> {
        match self {
            Self::KilometrePerHour => Some(Length::Kilometre),
            Self::MilePerHour => Some(Length::Mile),
            Self::MetrePerSecond | Self::FootPerSecond => None,
        }
    }
}

impl Choice for Length {
    const ALL: &'static [Self] = &[Self::Metre, Self::Kilometre, Self::Foot, Self::Mile];

    fn name(self) -> &'static str {
        match self {
            Self::Metre => "metre",
            Self::Kilometre => "kilometre",
            Self::Foot => "foot",
            Self::Mile => "mile",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::Metre => "Metres",
            Self::Kilometre => "Kilometres",
            Self::Foot => "International feet",
            Self::Mile => "Statute miles",
        }
    }
}

impl Choice for Speed {
    const ALL: &'static [Self] = &[
        Self::KilometrePerHour,
        Self::MilePerHour,
        Self::MetrePerSecond,
        Self::FootPerSecond,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::KilometrePerHour => "km/h",
            Self::MilePerHour => "mph",
            Self::MetrePerSecond => "m/s",
            Self::FootPerSecond => "ft/s",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::KilometrePerHour => "Kilometres an hour",
            Self::MilePerHour => "Miles an hour",
            Self::MetrePerSecond => "Metres a second",
            Self::FootPerSecond => "Feet a second",
        }
    }
}
