//! The events of a run and of a loop as a program reads them: a name, and fields with their units.

use serde_json::{Map, Value, json};

use crate::closed_loop::LoopEvent;
use crate::criticism::SearchProgress;
use crate::infer::{ChainProgress, Settings};
use crate::report::{doubted, remedy};
use crate::run::Event;

/// Name and fields of an event.
pub(super) fn run_event(event: &Event<'_>) -> (&'static str, Value) {
    match event {
        Event::Surface { file, n_vertices, area, notes } => (
            "surface",
            json!({ "file": file, "vertices": n_vertices, "area_mm2": area, "notes": notes }),
        ),
        Event::Eigenfunctions { n_modes, n_vertices, seconds } => (
            "eigenfunctions",
            json!({ "modes": n_modes, "vertices": n_vertices, "seconds": seconds.round() }),
        ),
        Event::NotCached { folder } => ("not_cached", json!({ "folder": folder })),
        Event::Basis { n_modes, wavelength } => {
            ("basis", json!({ "modes": n_modes, "wavelength_mm": wavelength }))
        }
        Event::Measurements { file, n_rows, n_sites, notes } => (
            "measurements",
            json!({ "file": file, "rows": n_rows, "sites": n_sites, "notes": notes }),
        ),
        Event::Unread(left_out) => {
            let rows = left_out.iter().map(|(protocol, n)| (protocol.clone(), json!(n)));
            ("unread", json!({ "rows": rows.collect::<Map<_, _>>() }))
        }
        Event::Experiment { n_measurements, n_sites, lengthscale, repaired } => (
            "experiment",
            json!({
                "measurements": n_measurements, "sites": n_sites,
                "lengthscale_mm": lengthscale, "repaired": repaired,
            }),
        ),
        Event::WarmStart { folder, n_matched, n_unknowns, new, gone, unsupported } => (
            "warm_start",
            json!({
                "folder": folder, "matched": n_matched, "unknowns": n_unknowns, "new": new,
                "gone": gone,
                "unsupported": unsupported.iter().map(|chain| chain + 1).collect::<Vec<_>>(),
            }),
        ),
        Event::Resumed { folder, seconds } => {
            ("resumed", json!({ "folder": folder, "seconds": seconds }))
        }
        Event::Doubts(doubts) => {
            let each = doubts.iter().map(|d| json!({ "text": doubted(d), "remedy": remedy(d) }));
            ("doubts", json!({ "doubts": each.collect::<Vec<_>>() }))
        }
        Event::Sampling { model, n_unknowns, sampler, settings, seconds, bytes } => {
            let Settings { chains, warmup, draws, seed, .. } = settings;
            (
                "sampling",
                json!({
                    "model": model, "unknowns": n_unknowns, "sampler": sampler.name(),
                    "chains": chains, "warmup": warmup, "draws": draws, "seed": seed,
                    "seconds": seconds, "bytes": bytes,
                }),
            )
        }
        Event::Prior { model } => ("prior", json!({ "model": model })),
        Event::Laplace { model } => ("laplace", json!({ "model": model })),
        Event::Progress(progress) => ("progress", chain(progress)),
        Event::Sampled { n_draws, seconds } => {
            ("sampled", json!({ "draws": n_draws, "seconds": seconds }))
        }
        Event::LeavingOut { done, of } => ("leaving_out", json!({ "done": done, "of": of })),
        Event::Triangulation { n_vertices, of, corrected_by } => (
            "triangulation",
            json!({ "vertices": n_vertices, "of": of, "corrected_by": corrected_by }),
        ),
        Event::OnDisk { bytes, least, free } => {
            ("on_disk", json!({ "bytes": bytes, "least": least, "free": free }))
        }
        Event::NotKept { reason } => ("not_kept", json!({ "reason": reason })),
        Event::ChainFailed(error) => (
            "chain_failed",
            json!({ "chain": error.chain + 1, "failure": error.failure.to_string() }),
        ),
    }
}

fn chain(p: &ChainProgress) -> Value {
    json!({
        "chain": p.chain + 1, "phase": p.phase.to_string(), "done": p.iteration, "of": p.total,
        "divergences": p.divergences, "step_size": p.step_size,
    })
}

/// Name and fields of an event of a loop.
pub(super) fn loop_event(event: &LoopEvent<'_>) -> (&'static str, Value) {
    match event {
        LoopEvent::Search(SearchProgress { round, done, of }) => {
            ("search", json!({ "round": round + 1, "done": done, "of": of }))
        }
        LoopEvent::Searched => ("searched", json!({})),
        LoopEvent::Sample { which } => ("sample", json!({ "which": which })),
        LoopEvent::Fit(event) => run_event(event),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_and_rounds_are_counted_from_1() {
        let progress = ChainProgress {
            chain: 0,
            phase: crate::infer::Phase::Warmup,
            iteration: 3,
            total: 9,
            divergences: 0,
            step_size: 0.5,
        };
        let (name, fields) = run_event(&Event::Progress(&progress));
        assert_eq!(
            (name, fields.to_string().as_str()),
            (
                "progress",
                r#"{"chain":1,"phase":"warm-up","done":3,"of":9,"divergences":0,"step_size":0.5}"#
            )
        );
        let search = LoopEvent::Search(SearchProgress { round: 0, done: 2, of: 99 });
        assert_eq!(loop_event(&search).1.to_string(), r#"{"round":1,"done":2,"of":99}"#);
    }
}
