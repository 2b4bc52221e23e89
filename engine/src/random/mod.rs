//! The registry of random streams: every stream of random numbers in the crate gets its number here.
//!
//! A run has one seed. Whatever in it needs random numbers takes a `ChaCha8` stream of that seed; the
//! streams are told apart by their number, so that none repeats another's numbers:
//!
//! ```text
//! stream number = kind · 2³² + index
//! ```
//! Each [`Stream`] has a kind of its own, and its index counts chains, searches or sites. Because
//! every chain has its own stream, results do not depend on the number of threads.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// A use of random numbers in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// The draws of a chain, or what stands in their place (draws from a normal approximation).
    Chain(usize),
    /// The starting point of a chain.
    Start(usize),
    /// What is drawn for a chain once it has been sampled: constant modes, replicated measurements.
    AfterSampling(usize),
    /// The fields of a synthetic truth.
    Truth,
    /// The noise of synthetic measurements.
    Noise,
    /// The conduction velocity of a synthetic truth.
    Conduction,
    /// A search on data simulated without an effect.
    Null {
        /// How many effects had been found before, below 2¹².
        round: usize,
        /// The search within the round, below 2²⁰.
        search: usize,
    },
    /// Predictions of held-out measurements.
    HeldOut,
    /// Draws from the prior, as those of a chain.
    Prior(usize),
    /// The first approximation of the likelihood in the blocked sampler's warm-up.
    StandIn,
    /// What the blocked sampler proposes hyperparameters and coefficients together by.
    Leap,
    /// Lookaheads of the blocked sampler's particles, and how many of these there are.
    Anchors,
    /// A chain of the blocked sampler between two meetings of its chains.
    Blocked {
        /// Which of its moves, or the completion of its draws with the second.
        part: Part,
        /// How many meetings there have been, below 2⁸.
        round: usize,
        /// The chain, below 2²⁴.
        chain: usize,
    },
    /// Predictions of a site's measurements from those of the other sites.
    LeftOut {
        /// The site that is left out.
        site: usize,
    },
    /// Replicates of a measurement in a fit without it.
    WithoutRow {
        /// The measurement that is left out.
        row: usize,
    },
    /// Predictions of measurements from the others, with the coefficients integrated out.
    IntegratedOut {
        /// The point of the other unknowns.
        point: usize,
    },
    /// Points of the outer unknowns at which rows are left out.
    LeftOutPoints,
    /// Replicates that are drawn anew by weights.
    Resampled,
    /// What a model expects before anything is measured.
    Expected,
    /// A procedure with a seed of its own: see [`procedure`].
    Procedure,
}

/// The moves of the blocked sampler that have numbers of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Of the coefficients and the free unknowns.
    Inner,
    /// Of the hyperparameters; also what completes a draw.
    Hyper,
    /// Of scouts, which look for regimes that no chain has met.
    Scout,
}

impl Stream {
    /// The generator of this stream at its beginning, for a run with this seed.
    ///
    /// # Panics
    /// If an index is beyond its bound: the stream would be another's.
    pub fn rng(self, seed: u64) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(self.number());
        rng
    }

    fn number(self) -> u64 {
        let (kind, index) = match self {
            Self::Procedure => (0, 0),
            Self::Chain(chain) => (22, index(chain, 32)),
            Self::AfterSampling(chain) => (1, index(chain, 32)),
            Self::Truth => (2, 0),
            Self::Noise => (2, 1),
            Self::Conduction => (2, 2),
            Self::Null { round, search } => (4, index(round, 12) << 20 | index(search, 20)),
            Self::HeldOut => (8, 0),
            Self::Prior(chain) => (16, index(chain, 32)),
            Self::StandIn => (17, 0),
            Self::Leap => (17, 1),
            Self::Anchors => (17, 2),
            Self::LeftOutPoints => (17, 3),
            Self::Blocked { part: Part::Inner, round, chain } => (18, of_round(round, chain)),
            Self::Blocked { part: Part::Hyper, round, chain } => (19, of_round(round, chain)),
            Self::Blocked { part: Part::Scout, round, chain } => (25, of_round(round, chain)),
            Self::LeftOut { site } => (20, index(site, 32)),
            Self::Expected => (21, 0),
            Self::WithoutRow { row } => (23, index(row, 32)),
            Self::Resampled => (21, 1),
            Self::IntegratedOut { point } => (24, index(point, 32)),
            // counted from the top, as ever
            Self::Start(chain) => (u64::from(u32::MAX), u64::from(u32::MAX) - index(chain, 32)),
        };
        kind << 32 | index
    }
}

/// The generator of a procedure that has a seed of its own and needs one stream: a design of
/// experiments, a choice of sites, vectors to begin an iteration with.
///
/// It is stream 0, which is no use's of a run, so that the same number may be given for both seeds.
/// `experiment/next.rs`, whose noise must be the same for every question that is asked of one run, has
/// the fixed seed 1.
pub fn procedure(seed: u64) -> ChaCha8Rng {
    Stream::Procedure.rng(seed)
}

fn of_round(round: usize, chain: usize) -> u64 {
    index(round, 8) << 24 | index(chain, 24)
}

/// A number below 2^bits.
fn index(number: usize, bits: u32) -> u64 {
    let number = number as u64;
    assert!(number >> bits == 0, "random stream: expected an index below 2^{bits}, got {number}");
    number
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;
    use std::collections::BTreeMap;
    use std::fs;
    use std::path::{Path, PathBuf};

    /// Every stream with all its indices at the ends of their ranges and in between.
    fn all() -> Vec<Stream> {
        let of = |bits: u32| {
            let last = (1_usize << bits) - 1;
            [0, 1, 2, 3, 100, last / 2, last - 1, last]
        };
        let mut all = vec![
            Stream::Truth,
            Stream::Noise,
            Stream::Conduction,
            Stream::HeldOut,
            Stream::StandIn,
            Stream::Leap,
            Stream::Anchors,
            Stream::LeftOutPoints,
            Stream::Expected,
            Stream::Resampled,
            Stream::Procedure,
        ];
        for i in of(32) {
            all.extend([Stream::Chain(i), Stream::Start(i), Stream::AfterSampling(i)]);
            all.extend([Stream::Prior(i), Stream::LeftOut { site: i }]);
            all.push(Stream::WithoutRow { row: i });
            all.push(Stream::IntegratedOut { point: i });
        }
        for (round, search) in of(12).into_iter().flat_map(|r| of(20).map(|k| (r, k))) {
            all.push(Stream::Null { round, search });
        }
        for (round, chain) in of(8).into_iter().flat_map(|r| of(24).map(|c| (r, c))) {
            all.extend([Part::Inner, Part::Hyper, Part::Scout].map(|part| Stream::Blocked {
                part,
                round,
                chain,
            }));
        }
        all
    }

    #[test]
    fn no_two_streams_coincide() {
        let mut seen = BTreeMap::new();
        for stream in all() {
            if let Some(other) = seen.insert(stream.number(), stream) {
                panic!("{stream:?} is {other:?}");
            }
        }
        // the kinds are told apart by the upper half, so what holds at the ends holds in between
        let kinds: BTreeMap<u64, _> = seen.into_iter().map(|(n, s)| (n >> 32, s)).collect();
        assert_eq!(kinds.len(), 16);
    }

    #[test]
    fn the_numbers_of_streams_stay_what_they_are() {
        assert_eq!(Stream::Procedure.number(), 0);
        assert_eq!([0, 7].map(|i| Stream::Chain(i).number()), [22 << 32, (22 << 32) + 7]);
        assert_eq!([0, 7].map(|i| Stream::Start(i).number()), [u64::MAX, u64::MAX - 7]);
        assert_eq!(Stream::Null { round: 3, search: 5 }.number(), (1 << 34) + (3 << 20) + 5);
    }

    #[test]
    fn streams_of_one_seed_differ_and_are_the_same_again() {
        let first = |stream: Stream, seed| stream.rng(seed).next_u64();
        assert_ne!(first(Stream::Chain(0), 1), first(Stream::Chain(1), 1));
        assert_ne!(first(Stream::Chain(0), 1), first(Stream::Chain(0), 2));
        assert_eq!(first(Stream::HeldOut, 5), first(Stream::HeldOut, 5));
    }

    #[test]
    #[should_panic(expected = "expected an index below 2^12, got 4096")]
    fn an_index_beyond_its_bound_is_refused() {
        Stream::Null { round: 4096, search: 0 }.number();
    }

    fn sources(folder: &Path) -> Vec<PathBuf> {
        let mut files = vec![];
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                files.extend(sources(&path));
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
        files
    }

    #[test]
    fn no_other_file_makes_a_generator() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        for file in sources(&root) {
            let name = file.file_stem().unwrap().to_string_lossy().into_owned();
            if file.starts_with(root.join("random")) || name.ends_with("tests") {
                continue;
            }
            let text = fs::read_to_string(&file).unwrap();
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
            let makes = ["seed_from_u64", "set_stream", "from_seed("];
            assert!(
                !makes.iter().any(|m| code.contains(m)),
                "{}: see crate::random",
                file.display()
            );
        }
    }
}
