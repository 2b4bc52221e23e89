//! Single steps of activation, without a surface.

use super::*;
use rand::{RngExt as _, SeedableRng as _};

/// Fronts that were born opposite the inside of a side, and beside it. How many are known to be later than some time, and how
/// many of these are earlier. In a test that must fail, `slack` times the height is allowed.
fn known(slack: f64) -> [usize; 2] {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut count = [0; 2];
    for _ in 0..20_000 {
        let mut at = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let (side, corner) = (at(0.5, 3.0), [at(-1.0, 4.0), at(0.1, 2.0)]);
        let (source, birth) = ([at(-4.0, 7.0), at(-6.0, -0.05)], at(-2.0, 2.0));
        let far = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
        let [a, b] = [[0.0, 0.0], [side, 0.0]];
        let sides = [side, far(corner, b), far(corner, a)];
        let timed = Timed { sides, area: side * corner[1] };
        // not quite the arrivals of that birth, as where the medium varies
        let ends = [a, b].map(|p| birth + far(p, source) * at(0.95, 1.05));
        let step = Step::new(&timed, 0, ends);
        for birth in [None, Some(birth)] {
            let along = step.along(0).min(step.along(1));
            let arrival = step.across(birth).map_or(along, |(arrival, _)| arrival);
            let time = ends[0].min(ends[1]) + at(0.0, 2.0);
            let slackened = ends[0].min(ends[1]) + (time - ends[0].min(ends[1])) / slack;
            if step.is_later_than(slackened, birth) {
                count[0] += 1;
                count[1] += usize::from(arrival < time * (1.0 - time.signum() * 1e-12));
            }
        }
    }
    count
}

#[test]
fn what_is_known_to_be_later_is() {
    let [known_later, earlier] = known(1.0);
    assert!(known_later > 10_000 && earlier == 0, "{known_later} {earlier}");
    assert!(known(1.2)[1] > 100);
}

/// A step over a triangle with the corners (0, 0), (`side`, 0) and `corner` where time is measured by the metric 1 + `by`.
fn measured(side: f64, corner: [f64; 2], ends: [f64; 2], by: [f64; 3]) -> Step {
    let [xx, xy, yy] = [1.0 + by[0], by[1], 1.0 + by[2]];
    let far = |d: [f64; 2]| (xx * d[0] * d[0] + 2.0 * xy * d[0] * d[1] + yy * d[1] * d[1]).sqrt();
    let sides = [far([side, 0.0]), far([corner[0] - side, corner[1]]), far(corner)];
    let area = side * corner[1] * (xx * yy - xy * xy).sqrt();
    Step::new(&Timed { sides, area }, 0, ends)
}

/// Numbers from `low` to `high`.
fn between(rng: &mut rand_chacha::ChaCha8Rng) -> impl FnMut(f64, f64) -> f64 {
    move |low: f64, high: f64| low + (high - low) * rng.random::<f64>()
}

/// Jumps of the arrival as a birthplace moves along 500 lines behind a side; `arrival` says when a corner is reached, if
/// across.
fn jumps(arrival: impl Fn(&Step) -> Option<f64>) -> usize {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
    let mut at = between(&mut rng);
    let mut count = 0;
    for _ in 0..500 {
        let (side, corner) = (at(0.5, 3.0), [at(-1.0, 4.0), at(0.1, 2.0)]);
        // not quite the arrivals of that birth, as where the medium varies
        let (later, far) =
            ([at(1.0, 1.05), at(1.0, 1.05)], |p: [f64; 2], x: f64| (p[0] - x).hypot(p[1]));
        let [from, to] = [0, 1].map(|_| [at(-1.0, 4.0), at(-3.0, -0.02)]);
        let value = |t: f64| {
            let born = [0, 1].map(|k| from[k] + t * (to[k] - from[k]));
            let ends = [later[0] * far(born, 0.0), later[1] * far(born, side)];
            let step = measured(side, corner, ends, [0.0; 3]);
            step.has_birthplace(0.0)
                .then(|| arrival(&step).unwrap_or_else(|| step.along(0).min(step.along(1))))
        };
        for k in 0..300 {
            let (mut low, mut high) = (f64::from(k) / 300.0, f64::from(k + 1) / 300.0);
            let gap = |low, high| value(low).zip(value(high)).map_or(0.0, |(a, b)| (a - b).abs());
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                let is_before = gap(low, middle) > gap(middle, high);
                (low, high) = if is_before { (low, middle) } else { (middle, high) };
            }
            count += usize::from(gap(low, high) > 1e-3);
        }
    }
    count
}

#[test]
fn arrivals_do_not_jump_as_a_birthplace_moves() {
    assert_eq!(jumps(|step| step.across(Some(0.0)).map(|(arrival, _)| arrival)), 0);
    // all at once at a right angle
    let at_once = jumps(|step| {
        let arrival = step.round(0.0)?;
        let goes_over = step.over(0.0, arrival).is_some();
        if goes_over { step.plane() } else { Some(arrival) }
    });
    assert!(at_once > 20, "{at_once}");
}

#[test]
fn derivatives_where_a_front_goes_over_are_those_of_differences() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut at = between(&mut rng);
    // partly and wholly, to a plane front and to one along a side
    let mut seen = [[0; 2]; 2];
    let (mut n_compared, mut n_told_apart) = (0, 0);
    for _ in 0..20_000 {
        let (side, corner) = (at(0.5, 3.0), [at(0.0, 3.0), at(0.1, 2.0)]);
        let (born, birth) = ([at(0.0, 3.0), at(-1.5, -0.1)], at(-2.0, 2.0));
        let far = |x: f64| (born[0] - x).hypot(born[1]);
        let ends = [birth + at(1.0, 1.05) * far(0.0), birth + at(1.0, 1.05) * far(side)];
        let value = |ends: [f64; 2], birth: f64, by: [f64; 3]| {
            measured(side, corner, ends, by).across(Some(birth)).map(|(arrival, _)| arrival)
        };
        let step = measured(side, corner, ends, [0.0; 3]);
        let Some(arrival) = step.has_birthplace(birth).then(|| step.round(birth)).flatten() else {
            continue;
        };
        let Some(over) = step.over(birth, arrival) else { continue };
        let slope = step.across_slope(Some(birth));
        let (alone, _) = step.round_slope(birth);
        seen[usize::from(over.share >= 1.0)][usize::from(step.flat().1.is_some())] += 1;
        let (h, zero) = (1e-6, [0.0; 3]);
        let of_metric = |k: usize| {
            let parts = slope.ways.map(|([x, y], ms)| 0.5 * ms * [x * x, 2.0 * x * y, y * y][k]);
            parts.iter().sum::<f64>()
        };
        let mut metric = [zero; 3];
        (0..3).for_each(|k| metric[k][k] = h);
        let moved = |k: usize, by: f64| match k {
            0 => value([ends[0] + by, ends[1]], birth, zero),
            1 => value([ends[0], ends[1] + by], birth, zero),
            2 => value(ends, birth + by, zero),
            k => value(ends, birth, metric[k - 3].map(|x| x / h * by)),
        };
        let expected =
            [slope.ends[0], slope.ends[1], slope.birth, of_metric(0), of_metric(1), of_metric(2)];
        for (k, expected) in expected.into_iter().enumerate() {
            let (Some(more), Some(less)) = (moved(k, h), moved(k, -h)) else { continue };
            let difference = (more - less) / (2.0 * h);
            // one of them may be beyond a kink
            let [right, left] =
                [(h, more), (-h, less)].map(|(h, t)| (t - value(ends, birth, zero).unwrap()) / h);
            if (right - left).abs() > 1e-3 * (1.0 + right.abs()) {
                continue;
            }
            let is_near = |slope: f64| (difference - slope).abs() < 1e-4 * (1.0 + slope.abs());
            assert!(is_near(expected), "{k}: {difference} {expected}");
            n_compared += 1;
            // the broken twin: as if the front had stayed round
            n_told_apart += usize::from(k == 2 && !is_near(alone.birth));
        }
    }
    assert!(seen.iter().flatten().all(|n| *n > 50), "{seen:?}");
    assert!(n_compared > 1_000 && n_told_apart > 500, "{n_compared} {n_told_apart}");
}
