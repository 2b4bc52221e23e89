//! Rivals: causes that the best candidate cannot be told apart from.

use super::bench::Bench;
use super::candidate::Level;
use super::cause::Cause;
use super::fit::LaplaceFit;
use super::judgement::CLAIM;
use super::leave::Left;
use super::outer::{Free, optimise, score};
use super::screen::{r_squared, r_squared_on_fields};
use super::search::Tried;
use crate::model::forms::Extent;

/// A runner-up is a rival if its log Bayes factor is less than this below the best.
const RIVAL: f64 = 2.0;
/// A winner is not told apart from a rival if it adds less than this with the rival in the model.
const ADDS: f64 = 1.0;
/// If more than this share of a covariate (R²) lies in the span of the fitted fields, it could be
/// the fields' own doing, unless it adds [`DECISIVE`] to them.
const SPAN: f64 = 0.8;
/// If R² of one covariate on another is above this, they are the same.
const SAME: f64 = 0.95;
/// If R² of one covariate on another is above this, it must add [`DECISIVE`] with the other in the
/// model. Otherwise the way in which the two are written down, rather than the data, could prefer
/// one. Of unrelated covariates with up to five labels over 40 sites, one in a thousand is above
/// this.
const ALIKE: f64 = 0.4;
/// No difference in how the same thing is written down makes up for this log Bayes factor: odds of
/// 150 to 1.
const DECISIVE: f64 = 5.0;

/// The best candidate and what it is compared with.
pub(super) struct Duel<'a> {
    pub(super) best: &'a Tried,
    pub(super) base: &'a LaplaceFit,
    /// What the base leaves over.
    pub(super) left: &'a Left,
}

impl Bench<'_> {
    /// The causes that the best candidate cannot be told apart from.
    pub(super) fn rivals(&self, tried: &[Tried], duel: &Duel<'_>) -> Vec<Cause> {
        let Duel { best, base, .. } = *duel;
        let cause = |t: &Tried| &self.candidates[t.candidate].cause;
        let mut rivals: Vec<Cause> = vec![];
        for other in tried.iter().filter(|t| cause(t) != cause(best)) {
            if !rivals.contains(cause(other)) && self.is_rival(duel, other) {
                rivals.push(cause(other).clone());
            }
        }
        // the base's fields have bent after the cause that they lack
        let fit = best.fit.as_ref().unwrap_or(base);
        let r2 = || r_squared_on_fields(&self.engine, fit, best.candidate, self.step);
        let moves = self.candidates[best.candidate].level != Level::Noise;
        if moves && best.log_bf < DECISIVE && r2() > SPAN {
            rivals.push(Cause::SpatialField);
        }
        if self.adds_to_finer_fields(duel) < CLAIM {
            rivals.push(Cause::Short);
        }
        rivals
    }

    /// What the best candidate adds if the model's fields may have as many modes as they want.
    fn adds_to_finer_fields(&self, duel: &Duel<'_>) -> f64 {
        let Some(fit) = &duel.best.fit else { return 0.0 };
        let best = |fit: &LaplaceFit| {
            let finer = self.finer.iter().filter_map(|terms| {
                let active = [&fit.active[..], terms].concat();
                optimise(&self.engine, &active, fit, Free::Spread, self.step)
            });
            finer.map(|(_, score)| score).fold(score(fit, self.step), f64::max)
        };
        best(fit) - best(duel.base)
    }

    fn is_rival(&self, duel: &Duel<'_>, other: &Tried) -> bool {
        let best = duel.best;
        // what predicts nothing of what was left out is no rival, unless it goes with the best
        let predicts =
            |fit: &LaplaceFit| self.refutation(&[other.candidate], fit, duel.left).is_none();
        let [a, b] = [best, other].map(|t| self.column(t.candidate));
        if a.is_some() && a == b {
            return false; // a threshold and a curve of one column are forms of one cause
        }
        if let Some(fits) = self.fields(best, other) {
            let is_near = best.log_bf - other.log_bf < RIVAL;
            return predicts(fits[1]) && (is_near || self.is_better_field(fits[1], fits[0]));
        }
        let of_columns = a.is_some() && b.is_some();
        let alike =
            if of_columns { r_squared(&self.engine, best.candidate, other.candidate) } else { 0.0 };
        if alike > SAME || self.is_coarser(other, best) {
            return true;
        }
        if alike <= ALIKE && other.log_bf <= ADDS {
            return false;
        }
        // two causes that both add much with the other in the model are two effects
        let adds = self.adds(duel, other);
        let is_near = best.log_bf - other.log_bf < RIVAL;
        let is_one = adds < ADDS || (is_near && adds < CLAIM) || (alike > ALIKE && adds < DECISIVE);
        is_one && (alike > ALIKE || other.fit.as_ref().is_some_and(predicts))
    }

    /// Whether the labels of one column follow from those of another. No design tells the effects
    /// of such columns apart.
    fn is_coarser(&self, other: &Tried, best: &Tried) -> bool {
        let is_label = |t: &Tried| {
            let form = &self.candidates[t.candidate].form;
            form.as_ref().is_some_and(|form| form.extent() == Extent::Labels)
        };
        is_label(other)
            && is_label(best)
            && r_squared(&self.engine, other.candidate, best.candidate) > SAME
    }

    /// The fits of two candidates, if both are fields. Fields follow each other over the rows
    /// without being the same cause. The one with more evidence, which is also evidence about
    /// neighbours, is the better. The other is its rival if it has as much evidence, or says more
    /// about places where nothing was measured.
    fn fields<'t>(&self, best: &'t Tried, other: &'t Tried) -> Option<[&'t LaplaceFit; 2]> {
        let is_field = |t: &Tried| self.candidates[t.candidate].is_field();
        let fits = best.fit.as_ref().zip(other.fit.as_ref())?;
        (is_field(best) && is_field(other)).then_some(fits.into())
    }

    /// What the best candidate adds to the score with another one in the model.
    fn adds(&self, duel: &Duel<'_>, other: &Tried) -> f64 {
        let Duel { best, base, .. } = *duel;
        let with_both = || {
            let fit = other.fit.as_ref()?;
            let both = self.and(&fit.active, best.candidate);
            let mut outer = fit.outer.clone();
            let of_best = &best.fit.as_ref()?.outer;
            outer.outliers = outer.outliers.or(of_best.outliers);
            if self.candidates[best.candidate].is_scatter() {
                outer.scatter.extend(of_best.scatter.last().cloned());
            }
            let start = self.engine.fit(&outer, &both, Some(fit))?;
            let (_, both) = optimise(&self.engine, &both, &start, Free::Spread, self.step)?;
            Some(both - score(base, self.step) - other.log_bf)
        };
        // a cause that the screen stopped takes nothing away
        if other.fit.is_none() { best.log_bf } else { with_both().unwrap_or(0.0) }
    }
}
