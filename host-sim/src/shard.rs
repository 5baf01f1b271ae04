//! Work in parts, on as many machines: points of a sweep, runs of a study.

use std::str::FromStr;

/// One of several parts of a list: every `count`-th item from `index` on. Neighbours, which cost alike, go to different
/// parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 0.
    pub index: u32,
    /// How many there are.
    pub count: u32,
}

impl Shard {
    /// The only shard of a list that is not split.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Its items' places in a list of this length.
    pub fn of(self, length: usize) -> impl Iterator<Item = usize> {
        (self.index as usize..length).step_by(self.count as usize)
    }
}

impl FromStr for Shard {
    type Err = String;

    /// Reads `i/N` with `i` from 0 to N - 1; the error says what is expected.
    fn from_str(text: &str) -> Result<Self, String> {
        let (index, count) = text
            .split_once('/')
            .and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)))
            .ok_or("i/N, such as 0/8")?;
        match count {
            0 => Err("at least one shard".to_owned()),
            count if index < count => Ok(Self { index, count }),
            count => Err(format!("an index from 0 to {}", count - 1)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_share_all_items_and_no_item_twice() {
        for count in [1, 3, 7, 50] {
            let mut items: Vec<usize> = (0..count)
                .flat_map(|index| Shard { index, count }.of(20))
                .collect();
            items.sort_unstable();
            assert!(items.into_iter().eq(0..20), "{count}");
        }
    }

    #[test]
    fn a_shard_s_text_is_checked() {
        assert_eq!("6/7".parse(), Ok(Shard { index: 6, count: 7 }));
        let message = |text: &str| text.parse::<Shard>().unwrap_err();
        assert_eq!(message("7/7"), "an index from 0 to 6");
        assert_eq!(message("0/0"), "at least one shard");
        for text in ["3", "a/b", "-1/4", "1/", "1/2/3"] {
            assert_eq!(message(text), "i/N, such as 0/8");
        }
    }
}
