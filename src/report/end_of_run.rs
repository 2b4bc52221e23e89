//! What the end of a run says, from what `summary.json` and `run.json` hold: so it can be said again.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::text::after_number;
use super::{LooRecord, Row, RunRecord, console_table, verdict, verdict_lines};

/// The table, the errors against a known truth, leave-one-out figures, the verdict and the cost.
pub fn end_of_run(rows: &[Row], record: &RunRecord) -> String {
    let mut text = console_table(rows, false);
    if let Some(rmse) = &record.rmse {
        let _ = writeln!(text, "\n{}", rmse_line(rmse, &record.units));
    }
    if let Some(coverage) = &record.coverage {
        let percent = |x: &f64| format!("{:.0}", 100.0 * x);
        let one = |(name, shares): (&String, &[f64; 3])| {
            format!("{name} {} %", shares.each_ref().map(percent).join(", "))
        };
        let list: Vec<String> = coverage.iter().map(one).collect();
        let _ = writeln!(
            text,
            "Truth within the central 50, 90, 95 % interval, share of the surface: {}",
            list.join("; ")
        );
    }
    if let Some(loo) = &record.loo {
        let _ = writeln!(text, "{}", leave_one_out_figures(loo));
    }
    if !record.not_simulated.is_empty() {
        let names = record.not_simulated.join(", ");
        let _ = writeln!(
            text,
            "No posterior predictive of density {names}: only an `observe` can be simulated"
        );
    }
    for failed in &record.failed_chains {
        let _ = writeln!(text, "Failed: {failed}");
    }
    if !record.divergent_at.is_empty() {
        let _ = writeln!(text, "Divergences come from: {}", record.divergent_at.join(", "));
    }
    if let Some(strays) = &record.strays {
        let _ = writeln!(
            text,
            "Chains disagree: {strays}. A chain that stays elsewhere sees another mode, or drifts: draw more, \
             compare --sampler nuts, or look for what the model lacks (eplat loop)"
        );
    }
    let _ = writeln!(text, "{}", verdict_lines(&verdict(record, rows)));
    let seconds = &record.seconds;
    let _ = write!(
        text,
        "{} gradients of {:.2} µs, and {:.2} µs of the sampler's own for each; {:.1} s in all, {:.1} s of them sampling",
        record.grad_evals,
        record.ns_per_grad / 1000.0,
        record.sampler_ns_per_grad / 1000.0,
        seconds.total,
        seconds.warmup + seconds.sampling
    );
    text
}

/// Root mean squared errors by name, with the units that are known.
pub fn rmse_line(rmse: &BTreeMap<String, f64>, units: &BTreeMap<String, String>) -> String {
    let unit = |name: &String| units.get(name).map_or(String::new(), |unit| after_number(unit));
    let one = |(name, e): (&String, &f64)| format!("{name} {e:.1}{}", unit(name));
    let list: Vec<String> = rmse.iter().map(one).collect();
    format!("RMSE against the truth over the surface: {}", list.join(", "))
}

/// Leave-one-out totals, and where they are not from importance weights or cannot be relied on.
pub(super) fn leave_one_out_figures(loo: &LooRecord) -> String {
    let LooRecord { elpd_loo, se, p_loo, n_measurements: n, k_threshold, .. } = loo;
    let figures = format!("Leave-one-out elpd {elpd_loo:.1} ± {se:.1}, p_loo {p_loo:.1}");
    let each = [
        (loo.n_integrated, "with the fields integrated out"),
        (loo.n_left_out, "in fits without them"),
    ];
    let each = each.into_iter().filter(|(n, _)| *n > 0).map(|(n, how)| format!("{n} {how}"));
    let mended = each.collect::<Vec<_>>().join(" and ");
    match (mended.is_empty(), loo.n_high_k) {
        (true, 0) => {
            format!("{figures}; Pareto k at most {k_threshold:.2} at all {n} measurements")
        }
        (false, 0) => format!("{figures}; of {n} measurements, {mended}"),
        (nothing, high) => format!(
            "{figures}: not reliable, Pareto k is above {k_threshold:.2} at {high} of {n} measurements{}, worst {}; to know, draw more (--draws), or fit without one of them and predict it",
            if nothing { String::new() } else { format!(" ({mended})") },
            loo.worst.join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;
    use crate::diagnostics::verdict::{Physical, Share};

    #[test]
    fn an_error_without_a_unit_has_none() {
        let rmse = BTreeMap::from([("a".to_owned(), 1.25), ("b".to_owned(), 2.0)]);
        let units = BTreeMap::from([("a".to_owned(), "1".to_owned())]);
        assert!(rmse_line(&rmse, &units).ends_with(": a 1.2, b 2.0"));
    }

    #[test]
    fn all_that_is_known_is_said() {
        let rows = [samples::row("tau_out.m", "ms", 12.3)];
        let mut record = samples::record();
        record.questions.physical = Some(Physical {
            outside: 0.071,
            maps: vec![Share { name: "tau_out".to_owned(), share: 0.071 }],
            void: 0.0,
        });
        record.divergences = 4;
        record.not_simulated = vec!["series".to_owned()];
        record.divergent_at = vec!["s1s2 at site 1 (3)".to_owned()];
        record.strays = Some(
            "chain 2 in its draws 401 to 600, where tau_out.m is 19.2 ms, elsewhere 12.1 ± 0.9"
                .to_owned(),
        );
        record.failed_chains =
            vec!["chain 2 (seed 1), warm-up iteration 0: no step size".to_owned()];
        let reliable = end_of_run(&rows, &record);
        let line = "Leave-one-out elpd -52.2 ± 4.1, p_loo 8.2; Pareto k at most 0.70 at all 20";
        assert!(reliable.contains(line), "{reliable}");
        if let Some(loo) = &mut record.loo {
            loo.n_high_k = 2;
            loo.worst = vec!["s1s2 at site 1 (0.92)".to_owned()];
        }
        insta::assert_snapshot!(end_of_run(&rows, &record));
    }
}
