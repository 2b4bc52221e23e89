//! The point of a triangle that is nearest to another point.

use nalgebra::Vector3;

type Point = Vector3<f64>;

/// Weights of the corners at the point of the triangle that is nearest to `p`.
///
/// # Source
/// C. Ericson, Real-Time Collision Detection (2005), 5.1.5: the plane is cut into the regions that are
/// nearest to a corner, a side or the inside.
pub(super) fn nearest([a, b, c]: [Point; 3], p: Point) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let along = d1 / (d1 - d3);
        return [1.0 - along, along, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let along = d2 / (d2 - d6);
        return [1.0 - along, 0.0, along];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let along = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - along, along];
    }
    let sum = va + vb + vc;
    [va / sum, vb / sum, vc / sum]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};

    /// No point of a fine grid on the triangle is nearer, and where the weights say is one of its points.
    #[test]
    fn no_other_point_is_nearer() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut point = || Point::from_fn(|_, _| rng.random_range(-1.0..1.0));
        for _ in 0..300 {
            let (corners, p) = ([point(), point(), point()], 2.0 * point());
            let at = |w: [f64; 3]| corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
            let w = nearest(corners, p);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12 && w.iter().all(|w| *w >= 0.0));
            let found = (at(w) - p).norm();
            for (i, j) in (0..=40).flat_map(|i| (0..=40 - i).map(move |j| (i, j))) {
                let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                assert!(found <= (at([u, v, 1.0 - u - v]) - p).norm() + 1e-12);
            }
        }
    }
}
