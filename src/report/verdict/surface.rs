//! *Physical*, *informed* and *trusted*, in words.

use std::fmt::Write as _;

use super::{list, percent};
use crate::diagnostics::verdict::{
    Answer, Colour, Informed, Physical, Question, Reach, Share, Trusted,
};

/// Most parameters that are named.
const MOST_NAMED: usize = 4;

/// Parts of maps in words, the largest first.
fn shares(maps: &[Share]) -> Vec<String> {
    let mut maps: Vec<&Share> = maps.iter().collect();
    maps.sort_by(|a, b| b.share.total_cmp(&a.share));
    maps.iter().map(|m| format!("{} {}", m.name, percent(m.share))).collect()
}

pub(super) fn physical(physical: &Physical) -> Answer {
    let Physical { outside, maps, void } = physical;
    let mut sentence =
        format!("{} of (vertex, draw) pairs outside a declared range", percent(*outside));
    if *outside > 0.0 {
        let _ = write!(sentence, " ({})", shares(maps).join(", "));
    }
    if *void > 0.0 {
        let _ = write!(
            sentence,
            "; at {} of the vertices every draw is, so that nothing is known there",
            percent(*void)
        );
    }
    let remedy = match physical.colour() {
        Colour::Red => {
            "do not use these maps: check the unit of the table and the declared ranges, or give the means tighter priors"
        }
        _ => {
            "widen the declared ranges if the tissue can be so, else measure where `unphysical` in fields.vtp is large"
        }
    };
    Answer::new(Question::Physical, physical.colour(), sentence, remedy)
}

pub(super) fn informed(informed: &Informed) -> Answer {
    let Informed { fields, uninformed, n_parameters } = informed;
    let mut parts = vec![];
    if !fields.is_empty() {
        let fields = shares(fields).join(", ");
        parts.push(format!(
            "intervals less than half as wide as before on part of the surface: {fields}"
        ));
    }
    if *n_parameters > 0 {
        let n = n_parameters - uninformed.len();
        let mut text = format!("{n} of {n_parameters} parameters narrower than their prior");
        if !uninformed.is_empty() {
            let named: Vec<String> = uninformed.iter().take(MOST_NAMED).cloned().collect();
            let more = uninformed.len() - named.len();
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let _ = write!(text, " (not {}{more})", named.join(", "));
        }
        parts.push(text);
    }
    if parts.is_empty() {
        parts.push("no prior to compare with".to_owned());
    }
    let remedy = "the measurements tell nothing about this: measure more or elsewhere (eplat design next), or look at another quantity";
    Answer::new(Question::Informed, informed.colour(), parts.join("; "), remedy)
}

pub(super) fn trusted(trusted: &Trusted) -> Answer {
    let reach = |Reach { field, lengthscale, beyond }: &Reach| {
        format!("{} farther than {lengthscale:.0} mm for {field}", percent(*beyond))
    };
    let fields: Vec<String> = trusted.fields.iter().map(reach).collect();
    let sentence = format!(
        "surface farther than a lengthscale from every site: {}; the farthest point is {:.0} mm away",
        list(&fields),
        trusted.farthest
    );
    let remedy = "most of the map is extrapolated: use it near the sites alone, or measure more (eplat design next)";
    Answer::new(Question::Trusted, trusted.colour(), sentence, remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_figures_are_in_words() {
        let share = |name: &str, share| Share { name: name.to_owned(), share };
        let said = [
            physical(&Physical {
                outside: 0.771,
                maps: vec![share("tau_out", 0.3), share("apd_max", 0.651)],
                void: 0.12,
            }),
            physical(&Physical { outside: 0.0, maps: vec![share("tau_out", 0.0)], void: 0.0 }),
            informed(&Informed {
                fields: vec![share("tau_out", 0.913), share("apd_max", 0.002)],
                uninformed: vec!["tau_out.rho".to_owned()],
                n_parameters: 4,
            }),
            trusted(&Trusted {
                fields: vec![
                    Reach { field: "tau_out".to_owned(), lengthscale: 12.3, beyond: 0.55 },
                    Reach { field: "apd_max".to_owned(), lengthscale: 51.0, beyond: 0.0 },
                ],
                farthest: 31.2,
            }),
        ];
        let said = said.map(|a| format!("{} {}", a.colour, a.sentence)).join("\n");
        insta::assert_snapshot!(said, @r"
        red 77 % of (vertex, draw) pairs outside a declared range (apd_max 65 %, tau_out 30 %); at 12 % of the vertices every draw is, so that nothing is known there
        green 0 % of (vertex, draw) pairs outside a declared range
        amber intervals less than half as wide as before on part of the surface: tau_out 91 %, apd_max 0.2 %; 3 of 4 parameters narrower than their prior (not tau_out.rho)
        amber surface farther than a lengthscale from every site: 55 % farther than 12 mm for tau_out and 0 % farther than 51 mm for apd_max; the farthest point is 31 mm away
        ");
    }
}
