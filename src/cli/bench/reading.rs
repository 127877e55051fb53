//! Measures how fast the machine reads memory: the limit with which the superposition is compared.
//!
//! In: the columns as words. Out: their exclusive or, so that no word can be left out. Four streams at a time, as the
//! superposition reads four columns, in vectors as wide as the processor has: a loop for the smallest common instruction set
//! reads the cache at half its speed, and would make the superposition seem faster than its limit.

use rayon::prelude::*;

/// Reads all words on `threads` threads, each its own part.
pub fn read(words: &[u32], threads: usize) -> u32 {
    let part = words.len().div_ceil(threads.max(1)).max(1);
    words.par_chunks(part).map(streams).reduce(|| 0, |a, b| a ^ b)
}

fn streams(words: &[u32]) -> u32 {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") {
            // SAFETY: the processor has the feature that the function is compiled for.
            return unsafe { streams_avx512(words) };
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has the feature that the function is compiled for.
            return unsafe { streams_avx2(words) };
        }
    }
    streams_of::<16>(words)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn streams_avx512(words: &[u32]) -> u32 {
    streams_of::<32>(words)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn streams_avx2(words: &[u32]) -> u32 {
    streams_of::<16>(words)
}

/// Four quarters side by side, `LANES` words of each at a time: two registers a quarter, so that none waits for the last
/// result. Inlined into each of the functions above and compiled for its instruction set.
#[inline(always)]
fn streams_of<const LANES: usize>(words: &[u32]) -> u32 {
    let steps = words.len() / (4 * LANES);
    let quarter = steps * LANES;
    let quarters: [&[[u32; LANES]]; 4] =
        std::array::from_fn(|i| words[i * quarter..(i + 1) * quarter].as_chunks().0);
    let mut sums = [[0_u32; LANES]; 4];
    for step in 0..steps {
        for (sum, quarter) in sums.iter_mut().zip(quarters) {
            for (sum, word) in sum.iter_mut().zip(&quarter[step]) {
                *sum ^= word;
            }
        }
    }
    let left = words[4 * quarter..].iter();
    sums.as_flattened().iter().chain(left).fold(0, |a, b| a ^ b)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every word is read on every instruction set that is here, whatever is left behind the last whole step.
    #[test]
    fn every_word_is_read_once() {
        let words: Vec<u32> = (0..2000_u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
        for count in [0, 1, 63, 64, 127, 128, 129, 1000, 1999] {
            let exact = words[..count].iter().fold(0, |a, b| a ^ b);
            for threads in [0, 1, 3] {
                assert_eq!(read(&words[..count], threads), exact, "{count} words, {threads} threads");
            }
            assert_eq!([streams_of::<16>(&words[..count]), streams_of::<32>(&words[..count])], [exact; 2]);
        }
    }
}
