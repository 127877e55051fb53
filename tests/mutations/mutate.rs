//! Random damage to a file's bytes: as a disk, an editor or a forger would do it.

use greenstage::measure::poses;

/// Random numbers that are the same on every machine.
pub struct Random(poses::Random);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(poses::Random(seed.wrapping_mul(0xd134_2543_de82_ef95)))
    }

    pub fn next(&mut self) -> u64 {
        self.0.bits()
    }

    /// Below `end`; 0 where that is 0.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

/// Words that a number, a name or a bracket may be replaced by, between bars; the first is empty.
const WORDS: &str = concat!(
    "|0|-1|1|2|3|4|5|7|10|255|256|65536|2147483647|-2147483648|4294967295|4294967296",
    "|9223372036854775807|18446744073709551615|18446744073709551616|1000000000000000|0.5|-0.0|1e-320",
    "|1e30|1e160|1e308|1e309|-1e309|nan|inf|-inf|0x7f|1_000|true|\"\"|[]|[[[[|]]]]|{}|$|*|#|<|>|/>",
    "|&amp;|\\|\u{0}|\u{feff}|é|\r\n|name|x",
);

fn word(random: &mut Random) -> &'static str {
    let words: Vec<&str> = WORDS.split('|').collect();
    words[random.below(words.len())]
}

/// `bytes` with one to a dozen changes; parts may come from `other`, a file of the same kind.
pub fn mutated(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let changes = 1 + (random.next().trailing_zeros() as usize).min(3) * random.below(4);
    for _ in 0..changes {
        change(&mut bytes, other, random);
    }
    // The file grows by pieces of itself, but not without end.
    bytes.truncate(1 << 15);
    bytes
}

fn change(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    let at = random.below(bytes.len() + 1);
    let range = |random: &mut Random, length: usize, longest: usize| {
        let first = random.below(length + 1);
        first..(first + random.below(longest + 1)).min(length)
    };
    match random.below(14) {
        0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
        1 if at < bytes.len() => bytes[at] = random.next() as u8,
        2 if at < bytes.len() => bytes[at] = b"0123456789-+.eE \n\t\"'[]{}=,<>$*#/"[random.below(32)],
        3 => bytes.truncate(at),
        4 => drop(bytes.drain(range(random, bytes.len(), 64))),
        5 => {
            let part = bytes[range(random, bytes.len(), 200)].to_vec();
            bytes.splice(at..at, part);
        }
        6 => {
            let part = other[range(random, other.len(), 200)].to_vec();
            let there = range(random, bytes.len(), 200);
            bytes.splice(there, part);
        }
        // A number in binary.
        7 => {
            let values = [0, 1, 2, 0x7fff_ffff, 0xffff_ffff, 1 << 40, u64::MAX >> 1, u64::MAX];
            let value = values[random.below(values.len())];
            let width = [1, 2, 4, 8][random.below(4)];
            let (little, big) = (value.to_le_bytes(), value.to_be_bytes());
            let number = if random.below(2) == 0 { &little[..width] } else { &big[8 - width..] };
            bytes.iter_mut().skip(at).zip(number).for_each(|(byte, new)| *byte = *new);
        }
        // A run of the same.
        8 => {
            let part = word(random).as_bytes().repeat(random.below(300));
            bytes.splice(at..at, part);
        }
        9 | 10 => {
            let lines: Vec<(usize, usize)> = pieces(bytes, |byte| byte == b'\n');
            let (from, end) = lines[random.below(lines.len())];
            let to = bytes.len().min(end + 1);
            let line = bytes[from..to].to_vec();
            match random.below(3) {
                0 => drop(bytes.drain(from..to)),
                1 => drop(bytes.splice(to..to, line)),
                _ => {
                    let (to, _) = lines[random.below(lines.len())];
                    bytes.splice(to..to, line);
                }
            }
        }
        // A word of the file, or another, in place of a word.
        _ => {
            let words = pieces(bytes, |byte| !(byte.is_ascii_alphanumeric() || b"_.+-".contains(&byte)));
            let (from, to) = words[random.below(words.len())];
            let (first, last) = words[random.below(words.len())];
            let word = match random.below(3) {
                0 => bytes[first..last].to_vec(),
                _ => word(random).as_bytes().to_vec(),
            };
            bytes.splice(from..to, word);
        }
    }
}

/// The pieces between `ends`, each with the byte that ends it left out; at least one.
fn pieces(bytes: &[u8], ends: impl Fn(u8) -> bool) -> Vec<(usize, usize)> {
    let mut pieces = Vec::new();
    let mut first = 0;
    for (at, _) in bytes.iter().enumerate().filter(|(_, byte)| ends(**byte)) {
        pieces.push((first, at));
        first = at + 1;
    }
    pieces.push((first, bytes.len()));
    pieces
}
