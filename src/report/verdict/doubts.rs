//! What is wrong with measurements, in words.

use super::{list, rounded};
use crate::diagnostics::verdict::Doubt;
use crate::report::text::after_number;

/// Units that tables are often in by mistake: of the model, of the table, and what the table is to be
/// multiplied by.
const MISTAKEN: [(&str, &str, f64); 12] = [
    ("ms", "s", 1e3),
    ("ms", "us", 1e-3),
    ("s", "ms", 1e-3),
    ("mV", "V", 1e3),
    ("mV", "uV", 1e-3),
    ("V", "mV", 1e-3),
    ("mm", "cm", 10.0),
    ("mm", "m", 1e3),
    ("mm", "um", 1e-3),
    ("cm", "mm", 0.1),
    ("m/s", "mm/s", 1e-3),
    ("m/s", "cm/ms", 10.0),
];

/// What is doubtful, in a sentence.
pub fn doubted(doubt: &Doubt) -> String {
    match doubt {
        Doubt::Contradiction { place, unit: u, lines, measured } => format!(
            "{place}: {}{} (lines {}) exclude each other",
            list(measured),
            after_number(u),
            lines_in_words(lines)
        ),
        Doubt::Alike { observe, unit: u, n, measured } => {
            format!("{observe}: all {n} measurements are {measured}{}", after_number(u))
        }
        Doubt::Range { observe, unit: u, n, of, lines, measured, expected, .. } => {
            let [low, high] = expected.map(rounded);
            let u = after_number(u);
            let values = if measured[0] < measured[1] {
                format!("{} to {}", measured[0], measured[1])
            } else {
                measured[0].to_string()
            };
            format!(
                "{observe}: {n} of {of} measurements ({values}{u}, lines {}{}) are far from what the model can mean, {low} to {high}{u}",
                lines_in_words(lines),
                if lines.len() < *n { " …" } else { "" }
            )
        }
        Doubt::Breakthrough { activation, vertex, later, gain, rows: [n, of] } => {
            let when = match *later {
                later if later < 0.0 => format!("{:.0} ms earlier", -later),
                later => format!("{later:.0} ms later"),
            };
            format!(
                "{activation}: a front that starts at vertex {vertex}, {when}, and reaches {n} of {of} rows first, would explain them better by {gain:.0} nats"
            )
        }
        Doubt::Regimes { vertex, n, share, fields } => {
            let more = match n {
                1 => String::new(),
                n => format!(" and {} more", n - 1),
            };
            format!(
                "at vertex {vertex}{more} the measurements allow two regimes: {}, or {} ({:.0} % of the draws)",
                regime(fields, 1),
                regime(fields, 0),
                100.0 * share
            )
        }
    }
}

/// As `tau_out 15 ms and apd_max 131 ms`, of one of two regimes.
fn regime(fields: &[(String, String, [f64; 2])], which: usize) -> String {
    let one = |(name, unit, means): &(String, String, [f64; 2])| {
        format!("{name} {}{}", rounded(means[which]), after_number(unit))
    };
    list(&fields.iter().map(one).collect::<Vec<_>>())
}

/// What to do about a doubt.
pub fn remedy(doubt: &Doubt) -> String {
    match doubt {
        Doubt::Contradiction { .. } => {
            "mend or drop these rows, or give the likelihood a noise that explains them".to_owned()
        }
        Doubt::Alike { .. } => {
            "where nothing varies, neither an amplitude nor a lengthscale can be learnt: was the column filled in by mistake? Else measure where it differs"
                .to_owned()
        }
        Doubt::Range { unit, factor: Some(factor), .. } => {
            let is_it = |(model, _, times): &&(&str, &str, f64)| {
                model == unit && (times / factor - 1.0).abs() < 1e-9
            };
            match MISTAKEN.iter().find(is_it) {
                Some((model, table, _)) => {
                    format!(
                        "is the table in {table}? The model is in {model}: multiply by {factor}"
                    )
                }
                None => format!("times {factor} they would fit: is the table in another unit?"),
            }
        }
        Doubt::Breakthrough { .. } => {
            "did activation start there, too, or there alone? Name the vertex in a column `source2`, or in `source`, and fit again"
                .to_owned()
        }
        Doubt::Regimes { .. } => {
            "a mean between the two is neither: look at quantiles there, and measure again nearby, or another quantity, to tell which it is"
                .to_owned()
        }
        Doubt::Range { .. } => "mend or drop these rows, or widen the declared ranges".to_owned(),
    }
}

fn lines_in_words(lines: &[u64]) -> String {
    lines.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubts_name_their_lines_and_guess_the_unit() {
        let contradiction = Doubt::Contradiction {
            place: "s1s2 at site 0".to_owned(),
            unit: "ms".to_owned(),
            lines: vec![2, 22],
            measured: vec!["240 to 250".to_owned(), "150 to 160".to_owned()],
        };
        let range = |factor| Doubt::Range {
            observe: "s1s2".to_owned(),
            unit: "ms".to_owned(),
            n: 10,
            of: 10,
            lines: vec![2, 4],
            measured: [0.17, 0.25],
            expected: [101.7, 279.8],
            factor,
        };
        let alike = Doubt::Alike {
            observe: "s1s2".to_owned(),
            unit: "ms".to_owned(),
            n: 10,
            measured: "240 to 250".to_owned(),
        };
        let breakthrough = |later| Doubt::Breakthrough {
            activation: "arrival[5]".to_owned(),
            vertex: 1297,
            later,
            gain: 18.7,
            rows: [24, 120],
        };
        let field = |name: &str, means| (name.to_owned(), "ms".to_owned(), means);
        let regimes = Doubt::Regimes {
            vertex: 3501,
            n: 7,
            share: 0.138,
            fields: vec![field("tau_out", [14.93, 28.4]), field("apd_max", [130.8, 101.6])],
        };
        let said = [
            contradiction,
            alike,
            breakthrough(31.2),
            breakthrough(-4.6),
            regimes,
            range(Some(1e3)),
            range(Some(1e6)),
            range(None),
        ];
        let said =
            said.map(|doubt| format!("{}\n→ {}", doubted(&doubt), remedy(&doubt))).join("\n");
        insta::assert_snapshot!(said, @r"
        s1s2 at site 0: 240 to 250 and 150 to 160 ms (lines 2, 22) exclude each other
        → mend or drop these rows, or give the likelihood a noise that explains them
        s1s2: all 10 measurements are 240 to 250 ms
        → where nothing varies, neither an amplitude nor a lengthscale can be learnt: was the column filled in by mistake? Else measure where it differs
        arrival[5]: a front that starts at vertex 1297, 31 ms later, and reaches 24 of 120 rows first, would explain them better by 19 nats
        → did activation start there, too, or there alone? Name the vertex in a column `source2`, or in `source`, and fit again
        arrival[5]: a front that starts at vertex 1297, 5 ms earlier, and reaches 24 of 120 rows first, would explain them better by 19 nats
        → did activation start there, too, or there alone? Name the vertex in a column `source2`, or in `source`, and fit again
        at vertex 3501 and 6 more the measurements allow two regimes: tau_out 28.4 ms and apd_max 102 ms, or tau_out 14.9 ms and apd_max 131 ms (14 % of the draws)
        → a mean between the two is neither: look at quantiles there, and measure again nearby, or another quantity, to tell which it is
        s1s2: 10 of 10 measurements (0.17 to 0.25 ms, lines 2, 4 …) are far from what the model can mean, 102 to 280 ms
        → is the table in s? The model is in ms: multiply by 1000
        s1s2: 10 of 10 measurements (0.17 to 0.25 ms, lines 2, 4 …) are far from what the model can mean, 102 to 280 ms
        → times 1000000 they would fit: is the table in another unit?
        s1s2: 10 of 10 measurements (0.17 to 0.25 ms, lines 2, 4 …) are far from what the model can mean, 102 to 280 ms
        → mend or drop these rows, or widen the declared ranges
        ");
    }
}
