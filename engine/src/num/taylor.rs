//! A function of two numbers from its derivatives: its Taylor polynomial in what the numbers carry.

use super::Real;

/// Derivatives of a function of x and y. Number k of an order is that with k times y: of the second order `f_xx`,
/// `f_xy`, `f_yy`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Partials {
    pub(crate) first: [f64; 2],
    pub(crate) second: [f64; 3],
    pub(crate) third: [f64; 4],
}

impl Partials {
    /// Those of ln p, from those of p divided by p.
    #[inline]
    pub(crate) fn ln(self) -> Self {
        let Self { first: [x, y], second: [xx, xy, yy], third: [xxx, xxy, xyy, yyy] } = self;
        Self {
            first: [x, y],
            second: [xx - x * x, xy - x * y, yy - y * y],
            third: [
                xxx - 3.0 * xx * x + 2.0 * x * x * x,
                xxy - xx * y - 2.0 * xy * x + 2.0 * x * x * y,
                xyy - yy * x - 2.0 * xy * y + 2.0 * x * y * y,
                yyy - 3.0 * yy * y + 2.0 * y * y * y,
            ],
        }
    }

    /// The function at numbers whose real parts have these derivatives and this `value`.
    #[inline]
    pub(crate) fn at<D: Real>(self, value: f64, x: D, y: D) -> D {
        let Self { first, second: [xx, xy, yy], third: [xxx, xxy, xyy, yyy] } = self;
        let (x, y) = (x - x.re(), y - y.re()); // zero, but carrying the derivatives
        let mut sum = x * first[0] + y * first[1];
        if D::ORDER > 1 {
            sum += x * x * (0.5 * xx) + x * y * xy + y * y * (0.5 * yy);
        }
        if D::ORDER > 2 {
            sum += x * x * (x * (xxx / 6.0) + y * (0.5 * xxy));
            sum += y * y * (x * (0.5 * xyy) + y * (yyy / 6.0));
        }
        sum + value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Third;
    use num_dual::DualNum as _;

    #[test]
    fn a_logarithm_has_num_duals_derivatives_in_every_direction() {
        // p = x² y³ + x
        let p = |x: Third, y: Third| x * x * y.powi(3) + x;
        for [a, b, c] in [[[1.0, 0.0]; 3], [[0.0, 1.0]; 3], [[1.0, 0.3], [0.2, 1.0], [-0.7, 0.4]]] {
            let number = |re: f64, i: usize| Third::new(re, a[i], b[i], c[i], 0.0, 0.0, 0.0, 0.0);
            let (x, y) = (1.3, 0.8);
            let value = x * x * y * y * y + x;
            let of_p = Partials {
                first: [2.0 * x * y.powi(3) + 1.0, 3.0 * x * x * y * y],
                second: [2.0 * y.powi(3), 6.0 * x * y * y, 6.0 * x * x * y],
                third: [0.0, 6.0 * y * y, 12.0 * x * y, 6.0 * x * x],
            };
            let relative = Partials {
                first: of_p.first.map(|d| d / value),
                second: of_p.second.map(|d| d / value),
                third: of_p.third.map(|d| d / value),
            };
            let got = relative.ln().at(value.ln(), number(x, 0), number(y, 1));
            let expected = p(number(x, 0), number(y, 1)).ln();
            for (got, expected) in [
                (got.re, expected.re),
                (got.eps2, expected.eps2),
                (got.eps1eps3, expected.eps1eps3),
                (got.eps1eps2eps3, expected.eps1eps2eps3),
            ] {
                assert!((got - expected).abs() < 1e-12, "{got} {expected}");
            }
        }
    }
}
