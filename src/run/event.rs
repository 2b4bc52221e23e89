//! What a run tells while it goes on, and how it is stopped.

use std::fmt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::diagnostics::verdict::Doubt;
use crate::infer::{ChainError, ChainProgress, Settings};
use crate::model::Sampler;
use crate::report::{doubted, remedy};

/// Memory from which a run says how much it takes, GB.
const LARGE: f64 = 1.0;

/// Something that a run tells while it goes on. Its `Display` is what the program prints.
#[derive(Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// The surface is there.
    Surface {
        /// Its file; `None` for the embedded left atrium or a surface made in memory.
        file: Option<&'a Path>,
        /// Number of vertices.
        n_vertices: usize,
        /// Area, mm².
        area: f64,
        /// What was dropped of the file, and doubts about its unit.
        notes: &'a [String],
    },
    /// Eigenfunctions are computed, which takes a while.
    Eigenfunctions {
        /// How many.
        n_modes: usize,
        /// Number of vertices.
        n_vertices: usize,
        /// About how long it takes, s.
        seconds: f64,
    },
    /// The eigenfunctions could not be kept for the next run.
    NotCached {
        /// The cache.
        folder: &'a Path,
    },
    /// The eigenfunctions are there.
    Basis {
        /// How many of them the model uses.
        n_modes: usize,
        /// Wavelength of the last of these, mm.
        wavelength: f64,
    },
    /// The measurements are there, and have their place on the surface.
    Measurements {
        /// Their file, or the name of the table.
        file: &'a str,
        /// Number of rows.
        n_rows: usize,
        /// Number of vertices at which something was measured.
        n_sites: usize,
        /// How the file was read, where that was a choice.
        notes: &'a [String],
    },
    /// The table has rows of quantities that the model does not read: protocol and number.
    Unread(&'a [(String, usize)]),
    /// A synthetic experiment was made, as no measurements were given.
    Experiment {
        /// Number of measurements.
        n_measurements: usize,
        /// Number of sites.
        n_sites: usize,
        /// Lengthscale of the truth, mm.
        lengthscale: f64,
        /// Share of the truth's vertices that were repaired.
        repaired: f64,
    },
    /// The run starts from the draws of an earlier one.
    WarmStart {
        /// The folder of the earlier run.
        folder: &'a Path,
        /// How many unknowns start from a draw.
        n_matched: usize,
        /// Number of unknowns.
        n_unknowns: usize,
        /// Unknowns that the earlier run did not have; they start as usual.
        new: &'a [String],
        /// Unknowns that only the earlier run had; they are left out.
        gone: &'a [String],
        /// Chains, from 0, without a draw that the model supports; they start as usual.
        unsupported: &'a [usize],
    },
    /// The run goes on where it was interrupted.
    Resumed {
        /// Where it was kept.
        folder: &'a Path,
        /// Seconds of sampling that are done.
        seconds: f64,
    },
    /// What is wrong with the measurements, if anything, before anything is sampled.
    Doubts(&'a [Doubt]),
    /// Sampling begins.
    Sampling {
        /// The model's name.
        model: &'a str,
        /// Number of unknowns.
        n_unknowns: usize,
        /// The sampler.
        sampler: Sampler,
        /// Its settings.
        settings: &'a Settings,
        /// Seconds since the run began.
        seconds: f64,
        /// Memory that the run will take, about, bytes.
        bytes: u64,
    },
    /// Operators over the whole surface are computed on a triangulation between some of its vertices.
    Triangulation {
        /// Their number.
        n_vertices: usize,
        /// That of the surface.
        of: usize,
        /// The number of vertices of the finer triangles by which arrival times are corrected, if there are any.
        corrected_by: Option<usize>,
    },
    /// There is not enough memory for all that is reported of draws: it is kept on disk, and the run goes on.
    OnDisk {
        /// Memory that the run would take, about, bytes.
        bytes: u64,
        /// Memory that it takes so, about, bytes.
        least: u64,
        /// Memory that there is, bytes.
        free: u64,
    },
    /// Draws are made from the prior.
    Prior {
        /// The model's name.
        model: &'a str,
    },
    /// Draws are made from the normal approximation at the mode.
    Laplace {
        /// The model's name.
        model: &'a str,
    },
    /// Where one chain stands: about four times per second and chain, and at the end of each phase.
    Progress(&'a ChainProgress),
    /// Every chain has ended. What the draws say is computed next, which may take longer than drawing.
    Sampled {
        /// Number of draws, of all chains that came through.
        n_draws: usize,
        /// Wall time of drawing, s.
        seconds: f64,
    },
    /// Measurements are left out in fits of their own, as importance weights cannot tell how they are predicted.
    LeavingOut {
        /// Such fits that are done.
        done: usize,
        /// Such fits in all.
        of: usize,
    },
    /// The run goes on, but it can no longer be kept.
    NotKept {
        /// The file and the cause.
        reason: &'a str,
    },
    /// A chain ended without its draws; the others go on.
    ChainFailed(&'a ChainError),
}

impl fmt::Display for Event<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Surface { file, n_vertices, area, notes } => {
                match file {
                    None => {
                        let area = area / 100.0;
                        write!(
                            f,
                            "mesh   embedded left atrium: {n_vertices} vertices, area {area:.0} cm²"
                        )?;
                    }
                    Some(path) => write!(f, "mesh   {}: {n_vertices} vertices", path.display())?,
                }
                notes.iter().try_for_each(|note| write!(f, "\n       {note}"))
            }
            Self::Eigenfunctions { n_modes, n_vertices, seconds } => write!(
                f,
                "basis  computing {n_modes} eigenfunctions of {n_vertices} vertices: about {seconds:.0} s, this once …"
            ),
            Self::NotCached { folder } => write!(
                f,
                "warning: the cache {} cannot be written, so every run computes its eigenfunctions anew\nhelp: set EPLAT_CACHE to a folder that you may write to",
                folder.display()
            ),
            Self::Basis { n_modes, wavelength } => {
                write!(f, "basis  {n_modes} modes, down to a wavelength of {wavelength:.0} mm")
            }
            Self::Measurements { file, n_rows, n_sites, notes } => {
                let (rows, sites) = (count(*n_rows, "row"), count(*n_sites, "site"));
                write!(f, "data   {file}: {rows} at {sites}")?;
                notes.iter().try_for_each(|note| write!(f, "\n       {note}"))
            }
            Self::Unread(left_out) => {
                let each = left_out.iter().map(|(protocol, n)| format!("{n} of `{protocol}`"));
                let all = each.collect::<Vec<_>>().join(", ");
                write!(f, "data   left out rows that the model does not observe: {all}")
            }
            Self::Experiment { n_measurements, n_sites, lengthscale, repaired } => write!(
                f,
                "data   synthetic experiment: {n_measurements} measurements at {n_sites} sites, truth with lengthscale {lengthscale} mm, {:.1} % of vertices repaired",
                100.0 * repaired
            ),
            Self::WarmStart { folder, n_matched, n_unknowns, new, gone, unsupported } => {
                write!(f, "init   {}: {n_matched} of {n_unknowns} unknowns", folder.display())?;
                for (names, what) in
                    [(new, "new here, started as usual"), (gone, "only there, left out")]
                {
                    if !names.is_empty() {
                        write!(f, "\n       {what}: {}", names.join(", "))?;
                    }
                }
                unsupported.iter().try_for_each(|chain| {
                    write!(f, "\n       no support for chain {}, started as usual", chain + 1)
                })
            }
            Self::Resumed { folder, seconds } => {
                write!(f, "resume {}: {seconds:.1} s of sampling are done", folder.display())
            }
            Self::Doubts(doubts) => write!(f, "{}", doubts_in_words(doubts)),
            Self::Sampling { model, n_unknowns, sampler, seconds, bytes, .. } => {
                let name = sampler.name();
                write!(
                    f,
                    "model  {model}: {n_unknowns} unknowns, sampler {name}, ready in {seconds:.1} s"
                )?;
                let gigabytes = *bytes as f64 / 1e9;
                if gigabytes < LARGE {
                    return Ok(());
                }
                write!(f, "; about {gigabytes:.1} GB of memory")
            }
            Self::Triangulation { n_vertices, of, corrected_by } => {
                f.write_str(&triangulation_in_words(*n_vertices, *of, *corrected_by))
            }
            Self::OnDisk { bytes, least, free } => {
                f.write_str(&on_disk_in_words([*bytes, *least, *free]))
            }
            Self::Prior { model } => {
                write!(f, "model  {model}: draws from its prior, not from its posterior")
            }
            Self::LeavingOut { done, of } => write!(f, "left out: {done} of {of} measurements"),
            Self::Sampled { n_draws, seconds } => {
                write!(
                    f,
                    "draws  {n_draws} in {seconds:.1} s; maps, predictions and verdict next …"
                )
            }
            Self::Laplace { model } => {
                write!(f, "model  {model}: normal approximation at its mode, not sampled")
            }
            Self::Progress(p) => f.write_str(&chain_in_words(p)),
            Self::NotKept { reason } => write!(
                f,
                "warning: the run goes on, but cannot be resumed if interrupted: {reason}"
            ),
            Self::ChainFailed(error) => write!(f, "warning: {error}"),
        }
    }
}

/// Where a chain stands.
fn chain_in_words(p: &ChainProgress) -> String {
    format!(
        "chain {}  {:>5}/{}  {:<8} divergences {:<3} step {:.3}",
        p.chain + 1,
        p.iteration,
        p.total,
        p.phase.to_string(),
        p.divergences,
        p.step_size
    )
}

fn triangulation_in_words(n_vertices: usize, of: usize, corrected_by: Option<usize>) -> String {
    let words = if n_vertices < of {
        format!("{n_vertices} of the {of} vertices, those of all rows among them")
    } else {
        format!("all {of} vertices")
    };
    let finer = corrected_by
        .map(|finer| format!("; arrival times are corrected by those at {finer} vertices"));
    let what = "mesh   what depends on the whole surface is computed at";
    format!("{what} {words}{}", finer.unwrap_or_default())
}

/// What it takes in memory, what it takes so, and what there is, bytes.
fn on_disk_in_words(bytes: [u64; 3]) -> String {
    let [whole, least, free] = bytes.map(|bytes| bytes as f64 / 1e9);
    format!(
        "memory {whole:.2} GB are not there, {free:.2} GB are: draws go to the disk of the output folder, so that it takes about {least:.2} GB"
    )
}

/// A line for each doubt, and one for what to do.
pub(super) fn doubts_in_words(doubts: &[Doubt]) -> String {
    let one = |doubt: &Doubt| format!("warning: {}\n         → {}", doubted(doubt), remedy(doubt));
    doubts.iter().map(one).collect::<Vec<_>>().join("\n")
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Who is told of events, and may stop the run. The default is told nothing and never stops.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Called for every event, from any thread.
    pub on_event: &'a (dyn Fn(&Event<'_>) + Sync),
    /// Once this is true, chains end before their next transition.
    pub stop: &'a AtomicBool,
}

impl Watch<'_> {
    pub(super) fn tell(&self, event: &Event<'_>) {
        (self.on_event)(event);
    }

    pub(super) fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The flag of those who never stop.
static NEVER: AtomicBool = AtomicBool::new(false);

impl Default for Watch<'_> {
    fn default() -> Self {
        Self { on_event: &|_| (), stop: &NEVER }
    }
}

impl fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Watch").field("stop", self.stop).finish_non_exhaustive()
    }
}
