//! *Fits*, in words.

use std::fmt::Write as _;

use super::{doubted, doubts, list, rounded};
use crate::diagnostics::verdict::{Answer, Colour, Fits, Misfit, Question, Within};
use crate::report::text::after_number;

/// Most sets besides all measurements that are told one by one.
const MOST_SETS: usize = 4;

pub(super) fn answer(fits: &Fits) -> Answer {
    let (mut sentence, colour) = (shares(fits), fits.colour());
    if let (true, Some(worst)) = (fits.is_misfit(), &fits.worst) {
        let p = fits.p_value();
        let chance = if p < 0.001 { "below 0.001".to_owned() } else { format!("{p:.3}") };
        let _ = write!(sentence, "; too few of {} (probability of so few: {chance})", of(worst));
    }
    let mut answer = Answer::new(Question::Fits, colour, sentence, &remedy(fits));
    answer.details = fits.doubts.iter().map(doubted).collect();
    if colour > Colour::Green {
        answer.details.extend(fits.misfits.iter().map(misfit));
    }
    answer
}

/// How many measurements lie in their intervals, together and by statement.
fn shares(fits: &Fits) -> String {
    let Some((all, sets)) = fits.sets.split_first() else { return String::new() };
    let text = format!("{} of {} rows in their 90 % predictive intervals", all.inside, all.n);
    if sets.is_empty() || sets.len() > MOST_SETS {
        return text;
    }
    format!("{text} ({})", sets.iter().map(of).collect::<Vec<_>>().join(", "))
}

fn of(set: &Within) -> String {
    format!("{} {} of {}", set.name, set.inside, set.n)
}

fn misfit(misfit: &Misfit) -> String {
    let Misfit { line, place, unit: u, measured, predicted, is_impossible } = misfit;
    let (u, [low, high]) = (after_number(u), predicted.map(rounded));
    let how = if *is_impossible { ", which is impossible" } else { "" };
    format!("{place} (line {line}): {measured}{u}, predicted {low} to {high}{u}{how}")
}

fn remedy(fits: &Fits) -> String {
    let mut remedies: Vec<String> = fits.doubts.iter().map(doubts::remedy).collect();
    remedies.dedup();
    match () {
        () if !remedies.is_empty() => list(&remedies),
        () if fits.n_impossible > 0 => {
            "mend or drop the rows named, or give the likelihood Outliers(…)".to_owned()
        }
        () => "look for what the model lacks (eplat loop)".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_do_not_fit_are_named() {
        let within = |name: &str, n, inside| Within { name: name.to_owned(), n, inside };
        let sets = [
            within("all", 24, 20),
            within("s1s2", 12, 8),
            within("s1s2s3", 12, 12),
            within("site 0", 4, 0),
        ];
        let mut fits = Fits::new(&sets, 3);
        fits.misfits = vec![Misfit {
            line: 22,
            place: "s1s2 at site 0".to_owned(),
            unit: "ms".to_owned(),
            measured: "150 to 160".to_owned(),
            predicted: [220.0, 240.0],
            is_impossible: true,
        }];
        let said = answer(&fits);
        let lines = [said.sentence, said.details.join("\n"), said.remedy.unwrap()];
        insta::assert_snapshot!(lines.join("\n"), @r"
        20 of 24 rows in their 90 % predictive intervals (s1s2 8 of 12, s1s2s3 12 of 12); too few of site 0 0 of 4 (probability of so few: below 0.001)
        s1s2 at site 0 (line 22): 150 to 160 ms, predicted 220 to 240 ms, which is impossible
        look for what the model lacks (eplat loop)
        ");
        let fine = answer(&Fits::new(&sets[..1], 1));
        assert_eq!(fine.sentence, "20 of 24 rows in their 90 % predictive intervals");
        assert_eq!((fine.colour, fine.remedy), (Colour::Green, None));
    }
}
