//! *Sampled*, in words: whether the draws come from the posterior.
//!
//! # Source
//! Vehtari, Gelman, Simpson, Carpenter, Bürkner 2021, "Rank-normalization, folding, and localization: an improved R̂",
//! for the quantities and the smallest effective sample size; Betancourt 2016 for E-BFMI.

use crate::diagnostics::Summary;
use crate::diagnostics::verdict::{Answer, Colour, Question};
use crate::report::{Row, RunRecord};

/// Largest R̂ of a converged run.
///
/// Differs from Vehtari et al.: they recommend 1.01, which chains of a thousand draws on the heavy tails of an
/// amplitude–lengthscale posterior miss now and then by chance.
pub const MAX_R_HAT: f64 = 1.02;
/// Smallest bulk and tail effective sample size of a converged run.
pub const MIN_ESS: f64 = 400.0;
/// Largest share of divergent draws in a converged run.
pub const MAX_DIVERGENT: f64 = 0.01;
/// E-BFMI below which the sampler may have missed the tails.
pub const MIN_E_BFMI: f64 = 0.2;

/// The quantity with the worst figure.
struct Worst<'a> {
    name: &'a str,
    value: f64,
}

/// Judges a run by the worst of its rows, its divergences, its energies and the chains that failed.
///
/// A quantity that never varies has neither R̂ nor ESS (NaN) and is passed over; without any other there is
/// nothing to trust and the run has not converged.  Of a normal approximation the importance weights decide alone:
/// its draws are independent, so that R̂ and ESS say nothing.
pub(super) fn answer(record: &RunRecord, rows: &[Row]) -> Answer {
    let n_failed = record.failed_chains.len();
    let n_chains = record.settings.chains - n_failed;
    let n_draws = n_chains * record.settings.draws;
    if let Some(approximation) = &record.laplace {
        return approximation.answer(n_draws);
    }
    let failed = format!("{n_failed} of {} chains failed ✗", record.settings.chains);
    let failed = (n_failed > 0).then_some(failed);
    if n_chains < 2 {
        let sentence =
            "Not converged: one chain has no R̂, for there is no other to compare it with";
        let failed = failed.map_or(String::new(), |failed| format!("; {failed}"));
        return red(format!("{sentence}{failed}"), "use --chains 4, at least 2");
    }
    let share = record.divergences as f64 / (n_draws as f64).max(1.0);
    let (Some(r_hat), Some(ess)) =
        (worst(rows, |row| row.summary.r_hat), worst(rows, |row| -row.ess()))
    else {
        return red("Not converged: no quantity has an R̂ and an ESS".to_owned(), "raise --draws");
    };
    let figures = [
        (r_hat.value <= MAX_R_HAT, format!("worst R̂ {:.3} ({})", r_hat.value, r_hat.name)),
        (-ess.value >= MIN_ESS, format!("smallest ESS {:.0} ({})", -ess.value, ess.name)),
        (share <= MAX_DIVERGENT, divergences(record.divergences, n_draws)),
        // Written so that NaN, from a single draw, does not pass.
        (record.e_bfmi >= MIN_E_BFMI, format!("E-BFMI {:.2}", record.e_bfmi)),
    ];
    let converged = n_failed == 0 && figures.iter().all(|(fine, _)| *fine);
    let shown =
        figures.iter().map(|(fine, text)| if *fine { text.clone() } else { format!("{text} ✗") });
    let shown = failed.into_iter().chain(shown).collect::<Vec<_>>().join(", ");
    let mut advice = advice(figures.each_ref().map(|(fine, _)| *fine), record.divergences);
    if n_failed > 0 {
        advice.push("where chains failed may be what the others missed");
    }
    let advice = advice.join("; ");
    match (converged, advice.is_empty()) {
        (true, true) => green(format!("Converged: {shown}")),
        (true, false) => green(format!("Converged: {shown}; {advice}")),
        (false, _) => red(format!("Not converged: {shown}"), &advice),
    }
}

/// Whether R̂ and ESS of a quantity are those of a converged run. One that never varies has neither, and is passed over here, too.
pub(in crate::report) fn is_settled(of: &Summary) -> bool {
    let fails = of.r_hat > MAX_R_HAT || of.ess_bulk < MIN_ESS || of.ess_tail < MIN_ESS;
    !fails
}

fn green(sentence: String) -> Answer {
    Answer::new(Question::Sampled, Colour::Green, sentence, "")
}

fn red(sentence: String, remedy: &str) -> Answer {
    Answer::new(Question::Sampled, Colour::Red, sentence, remedy)
}

impl Row {
    /// The smaller of bulk and tail effective sample size.
    pub(in crate::report) fn ess(&self) -> f64 {
        self.summary.ess_bulk.min(self.summary.ess_tail)
    }
}

/// The row where `badness` is largest, NaN passed over.
fn worst(rows: &[Row], badness: impl Fn(&Row) -> f64) -> Option<Worst<'_>> {
    let figures = rows.iter().map(|row| Worst { name: &row.name, value: badness(row) });
    figures.filter(|figure| !figure.value.is_nan()).max_by(|a, b| a.value.total_cmp(&b.value))
}

fn divergences(n: usize, n_draws: usize) -> String {
    let percent = 100.0 * n as f64 / (n_draws as f64).max(1.0);
    match n {
        0 => format!("no divergence in {n_draws} draws"),
        1 => format!("1 divergence in {n_draws} draws ({percent:.2} %)"),
        _ => format!("{n} divergences in {n_draws} draws ({percent:.2} %)"),
    }
}

/// What to do about each figure that fails, and about divergences that are few.
fn advice([r_hat, ess, divergent, energy]: [bool; 4], n_divergent: usize) -> Vec<&'static str> {
    let remedies = [
        (
            !r_hat,
            "do not use these results: sample longer (--warmup, --draws) or simplify the model",
        ),
        (!divergent, "raise --target-accept towards 0.99"),
        (r_hat && !ess, "raise --draws"),
        (
            !energy,
            "the tails may be missed: where a scale multiplies other unknowns, write these as mean + scale * z with z ~ Normal(0, 1), or use a tighter prior on the scale",
        ),
        (
            divergent && n_divergent > 0,
            "raise --target-accept to see whether the divergences matter",
        ),
    ];
    remedies.into_iter().filter(|(due, _)| *due).map(|(_, remedy)| remedy).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::samples;

    fn judged(change: impl Fn(&mut RunRecord, &mut [Row])) -> String {
        let mut record = samples::record();
        let mut rows = ["tau_out.m", "tau_out.rho"].map(|name| samples::row(name, "ms", 10.0));
        change(&mut record, &mut rows);
        let answer = answer(&record, &rows);
        assert_eq!(answer.colour == Colour::Green, answer.sentence.starts_with("Converged"));
        assert_eq!(answer.colour == Colour::Red, answer.remedy.is_some());
        answer.sentence + &answer.remedy.map_or(String::new(), |remedy| format!(" → {remedy}"))
    }

    #[test]
    fn each_threshold_turns_the_verdict() {
        let sentences = [
            judged(|_, _| ()),
            judged(|record, _| record.failed_chains = vec!["chain 2: no step size".to_owned()]),
            judged(|record, _| record.divergences = 3),
            judged(|record, _| record.divergences = 41),
            judged(|_, rows| rows[1].summary.r_hat = 1.021),
            judged(|_, rows| rows[0].summary.ess_tail = 399.0),
            judged(|record, _| record.e_bfmi = f64::NAN),
            judged(|record, rows| {
                record.divergences = 41;
                record.e_bfmi = 0.1;
                rows[0].summary.ess_tail = 399.0;
            }),
            judged(|_, rows| rows[0].summary.r_hat = f64::NAN),
            judged(|_, rows| rows.iter_mut().for_each(|row| row.summary.r_hat = f64::NAN)),
            judged(|record, _| record.settings.chains = 1),
        ];
        insta::assert_snapshot!(sentences.join("\n"), @r"
        Converged: worst R̂ 1.002 (tau_out.rho), smallest ESS 1513 (tau_out.rho), no divergence in 4000 draws, E-BFMI 0.83
        Not converged: 1 of 4 chains failed ✗, worst R̂ 1.002 (tau_out.rho), smallest ESS 1513 (tau_out.rho), no divergence in 3000 draws, E-BFMI 0.83 → where chains failed may be what the others missed
        Converged: worst R̂ 1.002 (tau_out.rho), smallest ESS 1513 (tau_out.rho), 3 divergences in 4000 draws (0.07 %), E-BFMI 0.83; raise --target-accept to see whether the divergences matter
        Not converged: worst R̂ 1.002 (tau_out.rho), smallest ESS 1513 (tau_out.rho), 41 divergences in 4000 draws (1.02 %) ✗, E-BFMI 0.83 → raise --target-accept towards 0.99
        Not converged: worst R̂ 1.021 (tau_out.rho) ✗, smallest ESS 1513 (tau_out.rho), no divergence in 4000 draws, E-BFMI 0.83 → do not use these results: sample longer (--warmup, --draws) or simplify the model
        Not converged: worst R̂ 1.002 (tau_out.rho), smallest ESS 399 (tau_out.m) ✗, no divergence in 4000 draws, E-BFMI 0.83 → raise --draws
        Not converged: worst R̂ 1.002 (tau_out.rho), smallest ESS 1513 (tau_out.rho), no divergence in 4000 draws, E-BFMI NaN ✗ → the tails may be missed: where a scale multiplies other unknowns, write these as mean + scale * z with z ~ Normal(0, 1), or use a tighter prior on the scale
        Not converged: worst R̂ 1.002 (tau_out.rho), smallest ESS 399 (tau_out.m) ✗, 41 divergences in 4000 draws (1.02 %) ✗, E-BFMI 0.10 ✗ → raise --target-accept towards 0.99; raise --draws; the tails may be missed: where a scale multiplies other unknowns, write these as mean + scale * z with z ~ Normal(0, 1), or use a tighter prior on the scale
        Converged: worst R̂ 1.002 (tau_out.rho), smallest ESS 1513 (tau_out.rho), no divergence in 4000 draws, E-BFMI 0.83
        Not converged: no quantity has an R̂ and an ESS → raise --draws
        Not converged: one chain has no R̂, for there is no other to compare it with → use --chains 4, at least 2
        ");
    }
}
