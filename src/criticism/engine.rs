//! A model with what criticism adds to it, and its Laplace approximation.
//!
//! ```text
//! scalars of a row = constant + J x + τ a z_site + Σ_terms s Z β
//! p(y | τ, σ, other) ≈ p(y, x̂, ẑ, β̂) (2π)^(d/2) det(−∇²)^(−½)
//! ```
//! `x` are the model's linear unknowns ([`Split`]), `z_site ~ N(0, 1)` a random effect shared by a
//! site's rows with sd τ, β ~ N(0, 1) the coefficients of the terms that are tried, and σ the sd of
//! a further normal error of every row ([`Noise`]). Random effects touch only their own site, so
//! that they are eliminated one by one: the matrix that is factored has the size of (x, β).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

use crate::dsl::{Curvature, Model, Noise, RowId, Split, Tape};

/// An effect in its tried form: `sd Z β` on the named quantities, β ~ N(0, 1).
#[derive(Clone, Debug)]
pub struct Term {
    /// Fields and `let`s that it acts on.
    pub on: Vec<String>,
    /// Design, row-major (rows of the table, n).
    pub design: Vec<f64>,
    /// Number of coefficients.
    pub n: usize,
    /// What the design is multiplied by; `None` for the random effect of a unit, whose sd is one of the
    /// outer values ([`Outer::ln_unit`]).
    pub sd: Option<f64>,
}

/// Everything of a fit that is not integrated out.
#[derive(Clone, Debug, PartialEq)]
pub struct Outer {
    /// The model's other unknowns, unconstrained.
    pub other: Vec<f64>,
    /// ln sd of the random effect of sites.
    pub ln_site: f64,
    /// ln sd of the further error of rows.
    pub ln_noise: f64,
    /// ln sd of the random effect of units (recordings, sessions), where they have one.
    pub ln_unit: Option<f64>,
    /// Share and sd of outlying rows.
    pub outliers: Option<(f64, f64)>,
}

impl Outer {
    pub(super) fn noise(&self) -> Noise {
        Noise {
            variance: (2.0 * self.ln_noise).exp(),
            outliers: self.outliers.map(|(share, sd)| (share, sd * sd)),
        }
    }
}

/// A row's place in the engine.
#[derive(Clone, Copy, Debug)]
pub struct RowAt {
    /// The row in the model.
    pub id: RowId,
    /// Its site.
    pub site: usize,
    /// Its first scalar.
    pub first: usize,
    /// Number of scalars.
    pub n: usize,
    /// The scalar, from `first` on, that is its observable: what site effects act on.
    pub observable: usize,
}

/// A model laid out for Laplace fits.
#[derive(Debug)]
pub struct Engine {
    /// The model, with offsets for everything that is tried.
    pub model: Model,
    /// Its linear unknowns and the others.
    pub split: Split,
    /// Rows, in the model's order.
    pub rows: Vec<RowAt>,
    /// Rows of each site.
    pub sites: Vec<Vec<usize>>,
    /// What can be tried.
    pub terms: Vec<Term>,
    n_locals: usize,
}

/// A Laplace fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// What it was made at.
    pub outer: Outer,
    /// Terms in it.
    pub active: Vec<usize>,
    /// Mode: linear unknowns, then coefficients of the terms.
    pub x: DVector<f64>,
    /// Mode of the sites' random effects, in units of their sd.
    pub z: Vec<f64>,
    /// Log evidence, up to a constant of the data alone.
    pub ln_evidence: f64,
    /// Scalars of all rows at the mode.
    pub locals: Vec<f64>,
    linear: Linear,
    factor: Cholesky<f64, Dyn>,
    /// Precision of each site's effect, and its coupling to x.
    precision: Vec<f64>,
    coupling: Vec<DVector<f64>>,
    curvatures: Vec<Curvature>,
}

/// The scalars of all rows as a linear map.
#[derive(Clone, Debug)]
struct Linear {
    constant: Vec<f64>,
    /// Row-major (scalars, unknowns).
    j: Vec<f64>,
    n: usize,
}

impl Linear {
    fn row(&self, local: usize) -> &[f64] {
        &self.j[local * self.n..][..self.n]
    }
}

/// What a site's rows would depend on, had they not been seen: mean and covariance of their scalars.
#[derive(Clone, Debug)]
pub struct Cavity {
    /// The rows.
    pub rows: Vec<usize>,
    /// Mean of their scalars, one row after the other.
    pub mean: DVector<f64>,
    /// Covariance.
    pub covariance: DMatrix<f64>,
}

/// What the Newton iteration knows at a point.
struct Point {
    x: DVector<f64>,
    z: Vec<f64>,
    locals: Vec<f64>,
    curvatures: Vec<Curvature>,
    gradient: DVector<f64>,
    value: f64,
}

const MAX_NEWTON: usize = 60;

impl Engine {
    /// Lays `model` out; `observable[o]` is what site effects act on in the rows of `observe` number o,
    /// `site_of` gives the site of each row of the table.
    pub fn new(model: Model, observable: &[String], site_of: &[usize], terms: Vec<Term>) -> Self {
        let split = model.split();
        let mut rows = vec![];
        let mut first = 0;
        for id in model.row_ids() {
            let n = model.n_locals(id);
            let on = model.local_of(id, &observable[id.observe]).unwrap_or(0);
            rows.push(RowAt { id, site: site_of[model.table_row(id)], first, n, observable: on });
            first += n;
        }
        let n_sites = site_of.iter().max().map_or(0, |s| s + 1);
        let mut sites = vec![vec![]; n_sites];
        for (r, row) in rows.iter().enumerate() {
            sites[row.site].push(r);
        }
        Self { model, split, rows, sites, terms, n_locals: first }
    }

    /// The scalars as a linear map at these other unknowns, terms included.
    fn linear(&self, t: &mut Tape, outer: &Outer, active: &[usize]) -> Linear {
        let ids: Vec<RowId> = self.rows.iter().map(|r| r.id).collect();
        let n_linear = self.split.linear.len();
        let n = n_linear + active.iter().map(|a| self.terms[*a].n).sum::<usize>();
        let mut u = self.unknowns(&outer.other, &DVector::zeros(n));
        let (mut constant, mut moved) = (vec![], vec![]);
        self.model.locals_at(t, &u, &ids, &mut constant);
        let mut j = vec![0.0; self.n_locals * n];
        for (k, at) in self.split.linear.iter().enumerate() {
            u[*at] = 1.0;
            self.model.locals_at(t, &u, &ids, &mut moved);
            u[*at] = 0.0;
            for (l, (m, c)) in moved.iter().zip(&constant).enumerate() {
                j[l * n + k] = m - c;
            }
        }
        let mut column = n_linear;
        for a in active {
            let term = &self.terms[*a];
            let sd = term.sd.or(outer.ln_unit.map(f64::exp)).unwrap_or_default();
            for row in &self.rows {
                let z = &term.design[self.model.table_row(row.id) * term.n..][..term.n];
                for local in term.on.iter().filter_map(|on| self.model.local_of(row.id, on)) {
                    for (k, z) in z.iter().enumerate() {
                        j[(row.first + local) * n + column + k] += sd * z;
                    }
                }
            }
            column += term.n;
        }
        Linear { constant, j, n }
    }

    /// All unknowns of the model from the two kinds.
    pub fn unknowns(&self, other: &[f64], x: &DVector<f64>) -> Vec<f64> {
        let mut u = vec![0.0; other.len() + self.split.linear.len()];
        for (at, value) in self.split.other.iter().zip(other) {
            u[*at] = *value;
        }
        for (at, value) in self.split.linear.iter().zip(x.iter()) {
            u[*at] = *value;
        }
        u
    }

    /// The Laplace approximation at `outer` with the terms `active`, climbing from `start` (a mode with
    /// fewer terms will do); `None` where there is no mode.
    pub fn fit(&self, outer: &Outer, active: &[usize], start: Option<&Fit>) -> Option<Fit> {
        self.fit_without(&[], outer, active, start)
    }

    /// As [`Engine::fit`], rows whose number is in `hidden` (ascending) unseen.
    pub fn fit_without(
        &self,
        hidden: &[usize],
        outer: &Outer,
        active: &[usize],
        start: Option<&Fit>,
    ) -> Option<Fit> {
        let mut t = self.model.tape();
        let linear = self.linear(&mut t, outer, active);
        let (mut x, mut z) = (DVector::zeros(linear.n), vec![0.0; self.sites.len()]);
        if let Some(fit) = start {
            let n = fit.x.len().min(linear.n);
            x.rows_mut(0, n).copy_from(&fit.x.rows(0, n));
            z.clone_from(&fit.z);
        } else {
            let initial = self.model.initial();
            for (k, at) in self.split.linear.iter().enumerate() {
                x[k] = initial[*at];
            }
        }
        let prior = self.prior_curvature(&mut t, &outer.other, &x);
        let mut point = self.point(&mut t, hidden, outer, &linear, x, z)?;
        for _ in 0..MAX_NEWTON {
            let system = self.system(outer, &linear, &point, &prior)?;
            let (dx, dz) = system.step(&point);
            let gain = dx.dot(&point.gradient);
            let next = self.search(&mut t, hidden, outer, &linear, &point, &dx, &dz);
            let Some(next) = next else {
                return Some(self.finish(outer, active, linear, point, system));
            };
            let gained = next.value - point.value;
            point = next;
            if gained < 1e-7 && gain.abs() < 1e-3 {
                break;
            }
        }
        let system = self.system(outer, &linear, &point, &prior)?;
        Some(self.finish(outer, active, linear, point, system))
    }

    fn finish(
        &self,
        outer: &Outer,
        active: &[usize],
        linear: Linear,
        point: Point,
        system: System,
    ) -> Fit {
        let ln_det = 2.0 * system.factor.l_dirty().diagonal().map(f64::ln).sum()
            + system.precision.iter().map(|p| p.ln()).sum::<f64>();
        // the terms' coefficients and the sites' effects are standard normal: their constants cancel
        let n_linear = self.split.linear.len() as f64;
        let ln_evidence = point.value + 0.5 * n_linear * std::f64::consts::TAU.ln() - 0.5 * ln_det;
        Fit {
            outer: outer.clone(),
            active: active.to_vec(),
            x: point.x,
            z: point.z,
            ln_evidence,
            locals: point.locals,
            linear,
            factor: system.factor,
            precision: system.precision,
            coupling: system.coupling,
            curvatures: point.curvatures,
        }
    }

    /// Minus the Hessian of the prior in the linear unknowns that are not standard normal.
    fn prior_curvature(&self, t: &mut Tape, other: &[f64], x: &DVector<f64>) -> DMatrix<f64> {
        const STEP: f64 = 1e-4;
        let n = self.split.linear.len();
        let mut curvature = DMatrix::zeros(n, n);
        let mut u = self.unknowns(other, x);
        let mut ends = [vec![0.0; u.len()], vec![0.0; u.len()]];
        for (k, at) in self.split.linear.iter().enumerate() {
            if self.split.is_eta[k] {
                curvature[(k, k)] = 1.0;
                continue;
            }
            let centre = u[*at];
            for (end, sign) in ends.iter_mut().zip([-1.0, 1.0]) {
                u[*at] = centre + sign * STEP;
                self.model.ln_prior(t, &u, end);
            }
            u[*at] = centre;
            for (i, other) in self.split.linear.iter().enumerate() {
                curvature[(i, k)] = (ends[0][*other] - ends[1][*other]) / (2.0 * STEP);
            }
        }
        0.5 * (&curvature + curvature.transpose())
    }

    fn point(
        &self,
        t: &mut Tape,
        hidden: &[usize],
        outer: &Outer,
        linear: &Linear,
        x: DVector<f64>,
        z: Vec<f64>,
    ) -> Option<Point> {
        let (noise, tau) = (outer.noise(), outer.ln_site.exp());
        let n_linear = self.split.linear.len();
        let u = self.unknowns(&outer.other, &x);
        let mut prior = vec![0.0; u.len()];
        let mut value = self.model.ln_prior(t, &u, &mut prior);
        let mut gradient = DVector::zeros(linear.n);
        for (g, at) in gradient.iter_mut().zip(&self.split.linear) {
            *g = prior[*at];
        }
        for k in n_linear..linear.n {
            value -= 0.5 * x[k] * x[k];
            gradient[k] = -x[k];
        }
        value -= 0.5 * z.iter().map(|z| z * z).sum::<f64>();
        let mut locals = linear.constant.clone();
        for (l, local) in locals.iter_mut().enumerate() {
            *local += linear.row(l).iter().zip(x.iter()).map(|(j, x)| j * x).sum::<f64>();
        }
        let mut curvatures = Vec::with_capacity(self.rows.len());
        for (r, row) in self.rows.iter().enumerate() {
            locals[row.first + row.observable] += tau * z[row.site];
            let mut c = Curvature::default();
            if hidden.binary_search(&r).is_ok() {
                c.gradient = vec![0.0; row.n];
                c.hessian = vec![0.0; row.n * row.n];
                curvatures.push(c);
                continue;
            }
            let own = &locals[row.first..][..row.n];
            self.model.row_curvature(row.id, own, &noise, &mut c);
            value += c.value;
            clip(&mut c.hessian, row.n);
            for (l, g) in c.gradient.iter().enumerate() {
                for (to, j) in gradient.iter_mut().zip(linear.row(row.first + l)) {
                    *to += g * j;
                }
            }
            curvatures.push(c);
        }
        value.is_finite().then_some(Point { x, z, locals, curvatures, gradient, value })
    }

    #[allow(clippy::too_many_arguments, reason = "the state of one Newton step")]
    fn search(
        &self,
        t: &mut Tape,
        hidden: &[usize],
        outer: &Outer,
        linear: &Linear,
        point: &Point,
        dx: &DVector<f64>,
        dz: &[f64],
    ) -> Option<Point> {
        let mut length = 1.0;
        for _ in 0..12 {
            let x = &point.x + dx * length;
            let z = point.z.iter().zip(dz).map(|(z, d)| z + length * d).collect();
            if let Some(next) =
                self.point(t, hidden, outer, linear, x, z).filter(|n| n.value > point.value)
            {
                return Some(next);
            }
            length *= 0.4;
        }
        None
    }

    /// Minus the Hessian at a point, sites eliminated.
    fn system(
        &self,
        outer: &Outer,
        linear: &Linear,
        point: &Point,
        prior: &DMatrix<f64>,
    ) -> Option<System> {
        let (n, tau) = (linear.n, outer.ln_site.exp());
        let mut s = DMatrix::zeros(n, n);
        s.view_mut((0, 0), prior.shape()).copy_from(prior);
        for k in prior.nrows()..n {
            s[(k, k)] = 1.0;
        }
        let mut precision = vec![1.0; self.sites.len()];
        let mut coupling = vec![DVector::zeros(n); self.sites.len()];
        let mut slope: Vec<f64> = point.z.iter().map(|z| -z).collect();
        let mut kj = vec![0.0; n];
        for (row, c) in self.rows.iter().zip(&point.curvatures) {
            for l in 0..row.n {
                kj.fill(0.0);
                for m in 0..row.n {
                    let k = -c.hessian[l * row.n + m];
                    if k != 0.0 {
                        for (to, j) in kj.iter_mut().zip(linear.row(row.first + m)) {
                            *to += k * j;
                        }
                    }
                }
                for (b, jl) in linear.row(row.first + l).iter().enumerate() {
                    if *jl != 0.0 {
                        let column = &mut s.column_mut(b);
                        for a in b..n {
                            column[a] += kj[a] * jl;
                        }
                    }
                }
                if l == row.observable {
                    precision[row.site] -= tau * tau * c.hessian[l * row.n + l];
                    slope[row.site] += tau * c.gradient[l];
                    for (b, k) in coupling[row.site].iter_mut().zip(&kj) {
                        *b += tau * k;
                    }
                }
            }
        }
        for (b, d) in coupling.iter().zip(&precision) {
            for k in 0..n {
                let scaled = b[k] / d;
                if scaled != 0.0 {
                    let column = &mut s.column_mut(k);
                    for a in k..n {
                        column[a] -= scaled * b[a];
                    }
                }
            }
        }
        let factor = Cholesky::new(s)?;
        Some(System { factor, precision, coupling, slope })
    }
}

/// The linear system of a Newton step.
struct System {
    factor: Cholesky<f64, Dyn>,
    precision: Vec<f64>,
    coupling: Vec<DVector<f64>>,
    /// Gradient in the sites' effects.
    slope: Vec<f64>,
}

impl System {
    fn step(&self, point: &Point) -> (DVector<f64>, Vec<f64>) {
        let mut right = point.gradient.clone();
        for ((b, d), g) in self.coupling.iter().zip(&self.precision).zip(&self.slope) {
            right.axpy(-g / d, b, 1.0);
        }
        let dx = self.factor.solve(&right);
        let dz = self.coupling.iter().zip(&self.precision).zip(&self.slope);
        let dz = dz.map(|((b, d), g)| (g - b.dot(&dx)) / d).collect();
        (dx, dz)
    }
}

/// Takes the positive part of a Hessian away: what is left is negative semidefinite.
fn clip(hessian: &mut [f64], n: usize) {
    let matrix = DMatrix::from_row_slice(n, n, hessian);
    let mut eigen = SymmetricEigen::new(matrix);
    if eigen.eigenvalues.iter().all(|e| *e <= 0.0) {
        return;
    }
    eigen.eigenvalues.apply(|e| *e = e.min(0.0));
    hessian.copy_from_slice(eigen.recompose().as_slice());
}

impl Fit {
    /// Coefficients of the terms: mean and covariance, in the order of `active`, times nothing.
    pub fn coefficients(&self, engine: &Engine) -> (DVector<f64>, DMatrix<f64>) {
        let (first, n) = (engine.split.linear.len(), self.x.len());
        let mut unit = DMatrix::zeros(n, n - first);
        for k in first..n {
            unit[(k, k - first)] = 1.0;
        }
        let covariance = self.factor.solve(&unit).rows(first, n - first).into_owned();
        (self.x.rows(first, n - first).into_owned(), covariance)
    }

    /// How a scalar depends on the linear unknowns and the terms' coefficients.
    pub(super) fn design_row(&self, local: usize) -> &[f64] {
        self.linear.row(local)
    }

    /// What these rows, all of one site, would depend on, had they not been seen.
    pub fn cavity(&self, engine: &Engine, rows: &[usize]) -> Option<Cavity> {
        let site = engine.rows[*rows.first()?].site;
        let tau = self.outer.ln_site.exp();
        let total: usize = rows.iter().map(|r| engine.rows[*r].n).sum();
        let n = self.x.len();
        let mut g = DMatrix::zeros(total, n);
        let mut a = DVector::zeros(total);
        let mut k = DMatrix::zeros(total, total);
        let (mut mean, mut slope) = (DVector::zeros(total), DVector::zeros(total));
        let mut at = 0;
        for r in rows {
            let row = &engine.rows[*r];
            let c = &self.curvatures[*r];
            for l in 0..row.n {
                for (to, j) in g.row_mut(at + l).iter_mut().zip(self.linear.row(row.first + l)) {
                    *to = *j;
                }
                mean[at + l] = self.locals[row.first + l];
                slope[at + l] = c.gradient[l];
                for m in 0..row.n {
                    k[(at + l, at + m)] = -c.hessian[l * row.n + m];
                }
            }
            a[at + row.observable] = 1.0;
            at += row.n;
        }
        let (d, b) = (self.precision[site], &self.coupling[site]);
        g.ger(-tau / d, &a, b, 1.0);
        let mut v = &g * self.factor.solve(&g.transpose());
        v.ger(tau * tau / d, &a, &a, 1.0);
        let covariance = (DMatrix::identity(total, total) - &v * k).lu().solve(&v)?;
        let covariance = 0.5 * (&covariance + covariance.transpose());
        let mean = mean - &covariance * slope;
        Some(Cavity { rows: rows.to_vec(), mean, covariance })
    }
}

#[cfg(test)]
#[path = "engine_tests.rs"]
mod tests;
