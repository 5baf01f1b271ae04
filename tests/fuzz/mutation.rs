//! Inputs that nobody would write, made of ones that somebody did.

use rand_core::Rng as _;
use rand_pcg::Pcg64Mcg;
use system_tests::below;

/// Numbers at the ends of what programs count with.
const NUMBERS: [&str; 30] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "0.5",
    "1e-300",
    "1e300",
    "1e308",
    "-1e308",
    "1e309",
    "inf",
    "-inf",
    "NaN",
    "127",
    "128",
    "255",
    "256",
    "32768",
    "65535",
    "65536",
    "2147483647",
    "2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "18446744073709551616",
    "1_000",
];

/// What texts stumble over.
const SNAGS: [&[u8]; 14] = [
    b"\0",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\r",
    b"\n\n",
    b"\"",
    b"'",
    b"<",
    b">",
    b"&amp;",
    b"]]>",
    b",,",
    b"~",
    b"\xc3\x28",
];

/// Longest input but for few.
const USUAL: usize = 16 << 10;

/// Longest input.
const LONGEST: usize = 4 << 20;

/// One in so many inputs may have the greatest length (chosen: they take a thousand times as long as others).
const LONG_ONES: u32 = 20_000;

/// Draws mutations.
pub struct Mutator {
    rng: Pcg64Mcg,
    /// Words of the corpus.
    words: Vec<Vec<u8>>,
}

impl Mutator {
    /// A seed draws the same inputs again, and others for each target.
    pub fn new(seed: u64, name: &str, corpus: &[Vec<u8>]) -> Self {
        let hash = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        let name = name.bytes().fold(0xcbf2_9ce4_8422_2325, hash);
        let part_of_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"._-+#".contains(byte);
        let words = corpus
            .iter()
            .flat_map(|input| input.split(move |byte| !part_of_word(byte)));
        let mut words: Vec<_> = words
            .filter(|word| (1..=40).contains(&word.len()))
            .map(<[u8]>::to_vec)
            .collect();
        words.sort();
        words.dedup();
        Self {
            rng: Pcg64Mcg::new(u128::from(seed) << 64 | u128::from(name)),
            words,
        }
    }

    fn below(&mut self, limit: usize) -> usize {
        below(&mut self.rng, limit.max(1) as u32) as usize
    }

    /// One of a corpus, changed in a few places.
    pub fn mutate(&mut self, corpus: &[Vec<u8>]) -> Vec<u8> {
        let mut input = corpus[self.below(corpus.len())].clone();
        let is_long = below(&mut self.rng, LONG_ONES) == 0;
        // Mostly one change: what has many is refused for the first.
        for _ in 0..1 + self.below(3) * self.below(3) {
            self.change(&mut input, corpus);
        }
        if is_long && !input.is_empty() {
            let (from, to) = self.range(&input);
            let piece = input[from..to.max(from + 1)].to_vec();
            let times = 1 + self.below((LONGEST - input.len().min(LONGEST)) / piece.len());
            input.splice(from..from, piece.repeat(times));
        }
        input.truncate(if is_long { LONGEST } else { USUAL });
        input
    }

    /// A part of an input, usually a short one.
    fn range(&mut self, input: &[u8]) -> (usize, usize) {
        let from = self.below(input.len());
        let most = match self.below(4) {
            0 => input.len() - from,
            _ => 16,
        };
        (from, (from + 1 + self.below(most)).min(input.len()))
    }

    /// The line around a place.
    fn line(&mut self, input: &[u8]) -> (usize, usize) {
        let at = self.below(input.len());
        let from = input[..at]
            .iter()
            .rposition(|byte| *byte == b'\n')
            .map_or(0, |end| end + 1);
        let length = input[at..].iter().position(|byte| *byte == b'\n');
        (from, length.map_or(input.len(), |length| at + length + 1))
    }

    /// The word around a place, or nothing there.
    fn word(&mut self, input: &[u8]) -> (usize, usize) {
        let at = self.below(input.len());
        let outside = |byte: &u8| !(byte.is_ascii_alphanumeric() || b"._-+".contains(byte));
        let from = input[..at].iter().rposition(outside).map_or(0, |end| end + 1);
        let length = input[from..].iter().position(outside);
        (from, length.map_or(input.len(), |length| from + length))
    }

    fn change(&mut self, input: &mut Vec<u8>, corpus: &[Vec<u8>]) {
        if input.is_empty() {
            let other = &corpus[self.below(corpus.len())];
            input.extend(other);
            return;
        }
        let at = self.below(input.len());
        match self.below(14) {
            0 => input[at] ^= 1 << self.below(8),
            1 => input[at] = self.rng.next_u32() as u8,
            2 => input[at] = input[at].wrapping_add(if self.below(2) == 0 { 1 } else { 255 }),
            3 => {
                let (from, to) = self.range(input);
                input.drain(from..to);
            }
            4 => {
                let (from, to) = self.range(input);
                let piece = input[from..to].to_vec();
                input.splice(at..at, piece);
            }
            5 => {
                let (from, to) = self.range(input);
                let piece = input[from..to].repeat(1 + self.below(60));
                input.splice(from..from, piece);
            }
            6 => {
                let (from, to) = self.line(input);
                input.drain(from..to);
            }
            7 => {
                let (from, to) = self.line(input);
                let line = input[from..to].to_vec();
                let (at, _) = self.line(input);
                input.splice(at..at, line);
            }
            8 => {
                let (from, to) = self.word(input);
                let number = NUMBERS[self.below(NUMBERS.len())];
                input.splice(from..to, number.bytes());
            }
            9 if !self.words.is_empty() => {
                let (from, to) = self.word(input);
                let word = self.below(self.words.len());
                input.splice(from..to, self.words[word].iter().copied());
            }
            10 => {
                let snag = SNAGS[self.below(SNAGS.len())];
                input.splice(at..at, snag.iter().copied());
            }
            11 => input.truncate(at),
            12 => {
                let other = &corpus[self.below(corpus.len())];
                let from = self.below(other.len());
                input.truncate(at);
                input.extend(&other[from..]);
            }
            _ => {
                let bytes = self.rng.next_u32().to_le_bytes();
                for (place, byte) in input[at..].iter_mut().zip(bytes) {
                    *place = byte;
                }
            }
        }
    }
}
