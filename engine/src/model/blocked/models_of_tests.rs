//! Models and tables that the tests of the blocked sampler share.

use crate::manifold::Basis;
use crate::model::Model;
use crate::prelude::*;
use crate::table::Measurements;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

model! {
    /// Known hyperparameters: the posterior is normal.
    model Known;
    field f(x) [ms] in 0.0..20.0 = m + 3.0 * gp(Rbf(Num::from(40.0)), K = 12) + 1.0 * gp(Matern32(Num::from(15.0)), K = 8) where {
        m [ms] ~ Flat;
    }
    observe direct(x): Number [ms] ~ Normal(f(x), 1.5);
}

model! {
    /// Unknown hyperparameters and noise, skew likelihood: counts, most of them zero.
    model Counts;
    column dose;
    param noise ~ HalfNormal(1.0);
    field f(x) in -2.0..2.0 = m + alpha * gp(Rbf(rho), K = 12) where {
        level ~ Normal(-1.0, 0.5);
        m     ~ Normal(level, 1.0);
        alpha ~ InvGamma(3.0, 2.0);
        rho [mm] ~ LogNormal(3.5, 0.5);
    }
    param slope ~ Normal(0.0, noise);
    let rate(x) = f(x) + slope * x.dose;
    observe beats(x): Count ~ PoissonLog(rate(x));
}

model! {
    /// Two fields of each patient: a group for each, of different sizes.
    model Patients;
    column dose;
    param level ~ Normal(0.5, 0.5);
    param spread ~ LogNormal(-0.7, 0.5); // not near 0, where NUTS would meet a funnel
    field f(x, patient) in -2.0..2.0 = m + alpha * gp(Rbf(rho), K = 12) where {
        m(patient) ~ Normal(level, spread);
        alpha ~ InvGamma(3.0, 2.0);
        rho [mm] ~ LogNormal(3.5, 0.5);
    }
    field g(x, patient) in -2.0..2.0 = 0.5 * gp(Rbf(Num::from(30.0)), K = 12);
    let rate(x) = f(x) + g(x) * x.dose;
    observe beats(x): Count ~ PoissonLog(rate(x));
}

model! {
    /// Places that differ by more than the field, as far as that is learnt.
    model Places;
    field f(x) in -2.0..2.0 = m + alpha * gp(Rbf(rho), K = 12) where {
        m     ~ Normal(0.5, 0.5);
        alpha ~ InvGamma(3.0, 2.0);
        rho [mm] ~ LogNormal(3.5, 0.5);
    }
    let rate(x) = f(x);
    param place_sd ~ LogNormal(-0.7, 0.5);
    effect difference on rate = group(row.place) ~ Normal(0.0, place_sd);
    observe beats(x): Count ~ PoissonLog(rate(x));
}

model! {
    /// Parameters beside a field: a flat one, one with a prior of its own, and labels whose spread is learnt.
    model Beside;
    column dose;
    param level ~ Flat;
    param slope ~ Normal(2.0, 3.0);
    param spread ~ LogNormal(-0.7, 0.5);
    param shift(patient) ~ Normal(1.0, spread);
    field f(x) = 3.0 * gp(Rbf(Num::from(40.0)), K = 6);
    observe direct(x): Number ~ Normal(f(x) + level + slope * x.dose + shift(x), 1.5);
}

model! {
    /// A hyperparameter that is measured itself, by rows that see no field.
    model Measured;
    param size ~ InvGamma(3.0, 2.0);
    field f(x) in -2.0..2.0 = m + size * gp(Rbf(rho), K = 12) where {
        m ~ Normal(-0.5, 0.5);
        rho [mm] ~ LogNormal(3.5, 0.5);
    }
    observe beats(x): Count ~ PoissonLog(f(x));
    observe direct(x): Number ~ Normal(size, 0.2);
}

model! {
    /// Deviations of places that act on measurements of no field.
    model Apart;
    field f(x) in -2.0..2.0 = m + gp(Rbf(Num::from(30.0)), K = 12) where { m ~ Normal(-0.5, 0.5); }
    param level ~ Normal(0.0, 1.0);
    let other(x) = level;
    param place_sd ~ LogNormal(-0.7, 0.5);
    effect difference on other = group(row.place) ~ Normal(0.0, place_sd);
    observe beats(x): Count ~ PoissonLog(f(x));
    observe direct(x): Number ~ Normal(other(x), 0.5);
}

/// At each of five places a row of the field, and one of another number that differs from place to place.
pub(super) fn apart() -> Model {
    let cells = |line: String| line.split(',').map(String::from).collect::<Vec<_>>();
    let row = |i: usize| {
        let protocol = if i.is_multiple_of(2) { "beats" } else { "direct" };
        cells(format!("{protocol},{},{},p{}", 7 * (i / 2), i % 3, i / 2))
    };
    let header = cells("protocol,vertex,value,place".into());
    let mut table = Measurements::from_cells("test", header, (0..10).map(row).collect()).unwrap();
    table.place_at_indices(60).unwrap();
    Model::new(&Apart, Some(&basis(12)), &table).unwrap()
}

/// Six rows of a field, and two of its amplitude alone.
pub(super) fn measured() -> Model {
    let cells = |line: String| line.split(',').map(String::from).collect::<Vec<_>>();
    let row = |i: usize| match i {
        3 | 7 => cells(format!("direct,{i},1.9")),
        _ => cells(format!("beats,{},{}", 7 * i, i % 4)),
    };
    let header = cells("protocol,vertex,value".into());
    let mut table = Measurements::from_cells("test", header, (0..8).map(row).collect()).unwrap();
    table.place_at_indices(60).unwrap();
    Model::new(&Measured, Some(&basis(12)), &table).unwrap()
}

/// Two rows at each of `n` places, whose labels are in another order than their vertices.
pub(super) fn places(n: usize) -> Model {
    let cells = |line: String| line.split(',').map(String::from).collect::<Vec<_>>();
    let row = |i: usize| cells(format!("beats,{},{},p{}", (7 * (i / 2)) % 60, i % 7 / 3, i / 2));
    let header = cells("protocol,vertex,value,place".into());
    let mut table =
        Measurements::from_cells("test", header, (0..2 * n).map(row).collect()).unwrap();
    table.place_at_indices(60).unwrap();
    Model::new(&Places, Some(&basis(12)), &table).unwrap()
}

/// Patients with rows mixed up: 2, 2 and 14 of 18, or 3, 5 and 30 of 38.
pub(super) fn patients(n_rows: usize) -> Model {
    Model::new(&Patients, Some(&basis(12)), &rows("beats", n_rows)).unwrap()
}

/// `n_modes` made-up modes at 60 vertices, the first constant.
pub(super) fn basis(n_modes: usize) -> Basis {
    let mut rng = ChaCha8Rng::seed_from_u64(12345);
    let n = 60 * n_modes;
    let entry =
        |i: usize| if i.is_multiple_of(n_modes) { 0.01 } else { rng.random_range(-0.017..0.017) };
    Basis {
        eigenvalues: (0..n_modes).map(|k| 4e-4 * k as f64).collect(),
        eigenfunctions: (0..n).map(entry).collect(),
    }
}

/// `n` rows of both models' measurements, at as many vertices.
pub(super) fn rows(protocol: &str, n: usize) -> Measurements {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let cells = |line: String| line.split(',').map(String::from).collect::<Vec<_>>();
    let row = |i: usize| {
        let value = if protocol == "beats" { i % 7 / 5 } else { 5 + i % 4 };
        let patient = match i {
            4 | 11 | 30 => "a",
            2 | 3 | 20 | 33 | 37 => "b",
            _ => "c",
        };
        cells(format!("{protocol},{i},{value},{},{patient}", rng.random_range(-1.0..1.0)))
    };
    let header = cells("protocol,vertex,value,dose,patient".into());
    let rows = (0..n).map(row).collect();
    let mut table = Measurements::from_cells("test", header, rows).unwrap();
    table.place_at_indices(60).unwrap();
    table
}
