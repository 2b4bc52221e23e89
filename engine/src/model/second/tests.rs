use super::*;
use crate::manifold::made_up as basis;
use crate::model::Declare;
use crate::prelude::*;
use crate::table::Measurements;

model! {
    /// Every kind of operation that has curvature.
    model Everything;
    column dose;
    param tau ~ HalfNormal(1.0);
    param nu ~ Gamma(2.0, 0.1);
    param b(label) ~ StudentT(nu, 0.3, tau);
    param share(3) ~ Dirichlet(2.0);
    param cuts(3) ~ Ordered(Normal(tau, 1.5));
    param beta(2) ~ Normal(0.0, tau);
    param noise ~ LogNormal(share[0], tau);
    field f(x) in 0.0..20.0 = m + (alpha * alpha) * gp(Rbf(rho), K = 6) + alpha * gp(Matern32(rho * 2.0), K = 4) where {
        m ~ Normal(3.0, tau);
        alpha ~ InvGamma(3.0, 2.0);
        rho [mm] ~ LogNormal(3.5, 0.5);
    }
    let eta(row) = linear(row.dose, row.dose; beta);
    let total(row) = f(row) * share[1] + eta(row) + b(row) * eta(row) + cuts[1];
    effect shift on total = scaled(row.dose, 0.1, 0.5) ~ Normal(0.0, 2.0);
    observe y(row): Number ~ StudentT(nu, total(row), noise);
    density extra = (tau - share[2]) * (share[2] - tau) * nu;
}

fn rows() -> Measurements {
    let text = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
    let cells = (0..10).map(|i| {
        let label = ["A", "B", "C"][i % 3];
        text(&format!("y,{i},{},{},{label}", 2.0 + 0.7 * (i % 4) as f64, 0.3 * i as f64 - 1.0))
    });
    let header = text("protocol,vertex,value,dose,label");
    let mut table = Measurements::from_cells("made up", header, cells.collect()).unwrap();
    table.place_at_indices(12).unwrap();
    table
}

/// Largest error of the exact columns against central differences of the gradient, relative to the
/// largest entry.
fn worst(model: &Model, u: &[f64], with_rows: bool) -> f64 {
    const STEP: f64 = 1e-4;
    let mut exact = Hessian::at(model, u, with_rows);
    let (mut t, mut moved) = (model.tape(), u.to_vec());
    let (mut error, mut most) = (0f64, 0f64);
    for i in 0..u.len() {
        let mut slope = |side: f64| {
            let mut gradient = vec![0.0; u.len()];
            moved[i] = u[i] + side * STEP;
            if with_rows {
                model.ln_density(&mut t, &moved, &mut gradient);
            } else {
                model.ln_prior(&mut t, &moved, &mut gradient);
            }
            moved[i] = u[i];
            gradient
        };
        let (up, down) = (slope(1.0), slope(-1.0));
        for (j, h) in exact.column(i).iter().enumerate() {
            error = error.max((h - (up[j] - down[j]) / (2.0 * STEP)).abs());
            most = most.max(h.abs());
        }
    }
    error / most
}

#[test]
fn the_hessian_is_the_derivative_of_the_gradient() {
    let model = Model::new(&Everything as &dyn Declare, Some(&basis()), &rows()).unwrap();
    let mut u = model.initial();
    for (i, u) in u.iter_mut().enumerate() {
        *u += 0.3 * ((i * 7 % 5) as f64 - 2.0) / 2.0;
    }
    // central differences are off by their step squared
    for with_rows in [false, true] {
        let worst = worst(&model, &u, with_rows);
        assert!(worst < 1e-6, "{with_rows}: {worst}");
    }
}

#[test]
fn the_hessian_is_symmetric() {
    let model = Model::new(&Everything as &dyn Declare, Some(&basis()), &rows()).unwrap();
    let u = model.initial();
    let mut hessian = Hessian::at(&model, &u, true);
    let columns: Vec<Vec<f64>> = (0..u.len()).map(|i| hessian.column(i).to_vec()).collect();
    for (i, column) in columns.iter().enumerate() {
        for (j, other) in columns.iter().enumerate() {
            let scale = column[i].abs().max(other[j].abs());
            assert!((column[j] - other[i]).abs() < 1e-9 * (1.0 + scale), "{i} {j}");
        }
    }
}
