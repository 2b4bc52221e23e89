//! Sums of products of Chebyshev's polynomials, one of each input, and their derivatives.
//!
//! ```text
//! f(x) = Σ c T_i(u₁) … T_k(u_D),   u_d = x_d scaled from its range to −1..1
//! ```

/// Highest degree of a term.
pub(super) const DEGREE: usize = 8;

/// The degree of Chebyshev's polynomial in each input, and the coefficient of the product.
pub type Term<const D: usize> = ([u8; D], f64);

/// `T_0`, `T_1`, … at one input, and their first to third derivatives in it.
#[derive(Clone, Copy, Default)]
struct Basis {
    t: [f64; DEGREE + 1],
    dt: [f64; DEGREE + 1],
    ddt: [f64; DEGREE + 1],
    dddt: [f64; DEGREE + 1],
}

impl Basis {
    /// The polynomials up to degree `highest`.
    fn fill(&mut self, x: f64, (lower, upper): (f64, f64), highest: usize, how: Derivatives) {
        let Derivatives { goes_on, order } = how;
        let slope = 2.0 / (upper - lower);
        let u = (x - 0.5 * (lower + upper)) * slope;
        let end = u.clamp(-1.0, 1.0);
        let Self { t, dt, ddt, dddt } = self;
        (t[0], t[1], dt[1]) = (1.0, end, slope);
        for i in 2..=highest {
            t[i] = 2.0 * end * t[i - 1] - t[i - 2];
            dt[i] = 2.0 * (slope * t[i - 1] + end * dt[i - 1]) - dt[i - 2];
        }
        let beyond = (u - end) / slope;
        if beyond == 0.0 {
            for i in 2..=if order > 1 { highest } else { 0 } {
                ddt[i] = 2.0 * (2.0 * slope * dt[i - 1] + end * ddt[i - 1]) - ddt[i - 2];
                dddt[i] = 2.0 * (3.0 * slope * ddt[i - 1] + end * dddt[i - 1]) - dddt[i - 2];
            }
        } else {
            for i in 0..=highest {
                t[i] += if goes_on { beyond * dt[i] } else { 0.0 };
                dt[i] = if goes_on { dt[i] } else { 0.0 };
            }
        }
    }
}

/// How polynomials are evaluated.
#[derive(Clone, Copy)]
pub(super) struct Derivatives {
    /// Whether they go on as straight lines beyond their range. If not, they keep their value at
    /// its end.
    pub(super) goes_on: bool,
    /// The highest derivative.
    pub(super) order: u32,
}

/// The polynomials of all inputs up to the degrees in `terms`.
fn bases<const D: usize>(
    terms: &[Term<D>],
    x: [f64; D],
    ranges: &[(f64, f64); D],
    how: Derivatives,
) -> [Basis; D] {
    let mut bases = [Basis::default(); D];
    for d in 0..D {
        let highest = terms.iter().fold(1, |most, (of, _)| of[d].max(most));
        bases[d].fill(x[d], ranges[d], usize::from(highest), how);
    }
    bases
}

/// The value and slopes of the sum of `terms`. Not inlined, so that it is compiled with eplat and not again with every
/// model.
#[inline(never)]
pub(super) fn value_and_slopes<const D: usize>(
    terms: &[Term<D>],
    x: [f64; D],
    ranges: &[(f64, f64); D],
    goes_on: bool,
) -> (f64, [f64; D]) {
    let bases = bases(terms, x, ranges, Derivatives { goes_on, order: 1 });
    let (mut value, mut slope) = (0.0, [0.0; D]);
    for (of, c) in terms {
        // products from the left and from the right
        let mut left = [*c; D];
        for d in 1..D {
            left[d] = left[d - 1] * bases[d - 1].t[usize::from(of[d - 1])];
        }
        let mut right = 1.0;
        for d in (0..D).rev() {
            let (basis, i) = (&bases[d], usize::from(of[d]));
            slope[d] += left[d] * right * basis.dt[i];
            right *= basis.t[i];
        }
        value += c * right;
    }
    (value, slope)
}

/// A function's second and third derivatives at a point.
pub(super) struct Higher<const D: usize> {
    pub(super) curvature: [[f64; D]; D],
    /// Where they are asked for.
    pub(super) third: [[[f64; D]; D]; D],
}

impl<const D: usize> Higher<D> {
    /// The derivatives of the sum of `terms`. Not inlined, for the same reason.
    #[inline(never)]
    pub(super) fn of(
        terms: &[Term<D>],
        x: [f64; D],
        ranges: &[(f64, f64); D],
        how: Derivatives,
    ) -> Self {
        let bases = bases(terms, x, ranges, how);
        let mut sum = Self { curvature: [[0.0; D]; D], third: [[[0.0; D]; D]; D] };
        for term in terms {
            sum.add_curvature(term, &bases);
            if how.order > 2 {
                sum.add_third(term, &bases);
            }
        }
        sum
    }

    /// Second derivatives of a term.
    fn add_curvature(&mut self, (of, c): &Term<D>, bases: &[Basis; D]) {
        for d in 0..D {
            for e in 0..D {
                self.curvature[d][e] += c * product(of, bases, &[d, e]);
            }
        }
    }

    /// Third derivatives of a term.
    fn add_third(&mut self, (of, c): &Term<D>, bases: &[Basis; D]) {
        for d in 0..D {
            for e in 0..D {
                for f in 0..D {
                    self.third[d][e][f] += c * product(of, bases, &[d, e, f]);
                }
            }
        }
    }
}

/// The product of a term's polynomials, differentiated in these inputs.
fn product<const D: usize>(of: &[u8; D], bases: &[Basis; D], by: &[usize]) -> f64 {
    let factor = |input: usize| {
        let Basis { t, dt, ddt, dddt } = &bases[input];
        let order = by.iter().filter(|d| **d == input).count();
        [t, dt, ddt, dddt][order][usize::from(of[input])]
    };
    (0..D).map(factor).product()
}
