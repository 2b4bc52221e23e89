//! Valid files with bytes changed, and what must hold for whoever reads them: a value or an error, soon, and never a
//! panic.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Duration;

use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::readers::Target;

/// CPU time that no file here takes, whatever stands in it.
const LONGEST: Duration = Duration::from_secs(2);

/// Bytes of memory that a reader may take for each byte of its files.
const MOST: usize = 10;

/// Bytes of memory that it may take beside, for any file. The most that was seen is 6 MB.
const BESIDE: usize = 16 << 20;

/// Calls what it is given; how many bytes it took at its peak, 0 from who does not count.
pub(crate) type Counted = fn(&mut dyn FnMut()) -> usize;

/// Texts that have broken readers before, as libFuzzer's dictionaries have them.
const DICTIONARY: &str = include_str!("../words.dict");

/// How long a target is tried.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Effort {
    /// So many mutations, of all its seeds together.
    Mutations(usize),
    /// So much CPU time.
    Time(Duration),
}

impl Effort {
    fn is_spent(self, done: usize, begun: Duration) -> bool {
        match self {
            Self::Mutations(n) => done >= n,
            Self::Time(time) => spent().saturating_sub(begun) >= time,
        }
    }
}

/// CPU time of this thread, in which every reader works; where Linux does not tell it, the time of day, which other
/// programs lengthen.
fn spent() -> Duration {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|told| told.split(' ').next()?.parse().ok());
    let of_day = || std::time::UNIX_EPOCH.elapsed().unwrap_or_default();
    nanoseconds.map_or_else(of_day, Duration::from_nanos)
}

/// The words of a dictionary: the text between quotes of each line, `\xNN`, `\\` and `\"` read.
pub(crate) fn words(dictionary: &str) -> Vec<Vec<u8>> {
    let quoted = |line: &str| Some(line.strip_prefix('"')?.strip_suffix('"')?.to_owned());
    dictionary.lines().filter_map(quoted).map(|text| unescaped(text.as_bytes())).collect()
}

fn unescaped(text: &[u8]) -> Vec<u8> {
    let hex = |digits: &[u8]| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok();
    let (mut bytes, mut rest) = (vec![], text);
    while let [first, more @ ..] = rest {
        let (byte, after) = match (first, more) {
            (b'\\', [b'x', high, low, after @ ..]) => (hex(&[*high, *low]), after),
            (b'\\', [escaped, after @ ..]) => (Some(*escaped), after),
            _ => (Some(*first), more),
        };
        bytes.extend(byte);
        rest = after;
    }
    bytes
}

/// Some bytes changed, taken away, repeated, or replaced by a word; perhaps cut.
fn mutated(bytes: &[u8], words: &[Vec<u8>], rng: &mut impl Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..rng.random_range(1..5) {
        // half of them where headers are
        let reach = if rng.random() { bytes.len().min(400) } else { bytes.len() };
        let at = rng.random_range(0..reach.max(1)).min(bytes.len().saturating_sub(1));
        let end = (at + rng.random_range(1..12)).min(bytes.len());
        match rng.random_range(0..6) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 if at < bytes.len() && bytes[at].is_ascii_digit() => {
                bytes[at] = b'0' + rng.random_range(0..10u8);
            }
            2 => drop(bytes.drain(at..end)),
            3 => drop(bytes.splice(end..end, bytes[at..end].to_vec())),
            4 => bytes.truncate(rng.random_range(0..=bytes.len())),
            _ => {
                let word = &words[rng.random_range(0..words.len())];
                drop(bytes.splice(at..end, word.iter().copied()));
            }
        }
    }
    bytes
}

/// Bytes of all files in a folder.
fn size(folder: &Path) -> usize {
    let files = std::fs::read_dir(folder).unwrap().flatten();
    files.map(|file| file.metadata().map_or(0, |found| found.len() as usize)).sum()
}

/// Reads mutations of the seeds of a target, one after the other; how many. Another `seed` gives other mutations.
///
/// # Panics
/// Where a reader panics, accepts what should have been refused, takes long or more memory than it may. The file is
/// kept in the temporary folder, and named.
pub(crate) fn survives(target: &Target, effort: Effort, seed: u64, counted: Counted) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let seeds = (target.seeds)(folder.path());
    let whole: Vec<Vec<u8>> = seeds.iter().map(|path| std::fs::read(path).unwrap()).collect();
    let restore = |path: &Path, bytes: &[u8]| std::fs::write(path, bytes).unwrap();
    for (path, bytes) in seeds.iter().zip(&whole) {
        (target.read)(path);
        restore(path, bytes);
    }
    let words = words(DICTIONARY);
    let mut rng =
        ChaCha8Rng::seed_from_u64(target.name.bytes().map(u64::from).sum::<u64>() + (seed << 32));
    let (begun, mut done) = (spent(), 0);
    while !effort.is_spent(done, begun) {
        let (path, bytes) = (&seeds[done % seeds.len()], &whole[done % seeds.len()]);
        let hostile = mutated(bytes, &words, &mut rng);
        restore(path, &hostile);
        let started = spent();
        let mut outcome = Ok(());
        let taken = counted(&mut || {
            outcome = catch_unwind(AssertUnwindSafe(|| (target.read)(path)));
        });
        let kept = || {
            let name = path.file_name().unwrap().display();
            let kept = std::env::temp_dir().join(format!("eplat-{}-{done}-{name}", target.name));
            restore(&kept, &hostile);
            kept.display().to_string()
        };
        assert!(outcome.is_ok(), "{}, mutation {done}: {}", target.name, kept());
        let is_soon = spent().saturating_sub(started) < LONGEST;
        assert!(is_soon, "{}, mutation {done} takes long: {}", target.name, kept());
        let allowed = MOST * size(folder.path()) + BESIDE;
        assert!(
            taken <= allowed,
            "{}, mutation {done} takes {taken} bytes of {allowed}: {}",
            target.name,
            kept()
        );
        restore(path, bytes);
        done += 1;
    }
    done
}
