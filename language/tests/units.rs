//! Mistakes of units and, as many, what is none.

#![allow(clippy::unwrap_used, reason = "tests")]

use eplat_language::{check, parse};

/// What is said about a model of these statements; empty if nothing.
fn said(statements: &str) -> String {
    let tokens = format!("model Case; {statements}").parse().unwrap();
    let model = parse(tokens).map_err(|m| m.message).unwrap();
    check(&model).iter().map(|m| m.message.clone()).collect::<Vec<_>>().join("\n")
}

macro_rules! mistakes {
    ($($name:ident: { $($statements:tt)* } => $message:literal;)*) => {$(
        #[test]
        fn $name() {
            assert_eq!(said(stringify!($($statements)*)), $message);
        }
    )*};
}

macro_rules! no_mistakes {
    ($($name:ident: { $($statements:tt)* };)*) => {$(
        #[test]
        fn $name() {
            assert_eq!(said(stringify!($($statements)*)), "");
        }
    )*};
}

mistakes! {
    a_lengthscale_in_ms: {
        field f(x) [ms] = m + a * gp(authors(Rbf(rho)), K = 4) where {
            m [ms] ~ Flat; a [ms] ~ HalfNormal(1.0); rho [ms] ~ InvGamma(1.0, 1.0);
        }
    } => "field f: `rho`: expected [mm] like every lengthscale, got [ms]";
    a_mean_in_mm: {
        field f(x) [ms] = m + a * gp(Rbf(rho), K = 4) where {
            m [mm] ~ Flat; a [ms] ~ HalfNormal(1.0); rho [mm] ~ InvGamma(1.0, 1.0);
        }
    } => "field f: `m`: expected [ms] as declared, got [mm]";
    an_eikonal_of_a_velocity: {
        field v(x) [m/s] within 0.1..1.5 = m + a * gp(Rbf(20.0), K = 4) where {
            m [m/s] ~ Normal(0.8, 0.3); a [m/s] ~ HalfNormal(1.0);
        }
        let t(row) [ms] = eikonal(v(row); row.source);
    } => "let t: `v(row)`: expected [ms/mm] as declared, got [m/s]";
    an_eikonal_with_an_angle_in_degrees: {
        param turned [deg] ~ Normal(0.0, 20.0);
        let t(row) [ms] = eikonal(1.2, 2.0, turned; row.source);
    } => "let t: `turned`: expected [rad] as an angle, got [deg]";
    an_eikonal_with_a_thickness_in_mm: {
        param thickness [mm] ~ HalfNormal(1.0);
        let t(row) [ms] = eikonal(1.2, 2.0, 0.3, thickness; row.source);
    } => "let t: `thickness`: expected [ms] as the thickness of a front, got [mm]";
    a_second_source_that_is_farther: {
        param later [mm] ~ Normal(0.0, 9.0);
        let t(row) [ms] = eikonal(1.2; row.source, row.source2 + later);
    } => "let t: `later`: expected [ms] as declared, got [mm]";
    a_path_of_a_velocity: {
        param v [m/s] ~ Normal(0.8, 0.3);
        let t(row) [ms] = path(v; row.source);
    } => "let t: `v`: expected [ms/mm] as declared, got [m/s]";
    a_gradient_of_a_voltage: {
        param v [mV] ~ Normal(0.8, 0.3);
        let t(row) [ms/mm] = gradient(v);
    } => "let t: `v`: expected [ms] as declared, got [mV]";
    the_inverse_of_a_gradient: {
        param late [ms] ~ Normal(0.8, 0.3);
        let t(row) [ms/mm] = gradient(late);
        let v(row) [mm] = 1.0 / t(row);
    } => "let v: `1.0 / t(row)`: expected [mm] as declared, got [m/s]";
    an_amplitude_times_a_share: {
        param share [1] ~ Beta(1.0, 1.0);
        field f(x) [ms] = m + (a * share) * gp(Rbf(rho), K = 4) where {
            m [ms] ~ Flat; a [mV] ~ HalfNormal(1.0); rho [mm] ~ InvGamma(1.0, 1.0);
        }
    } => "field f: `(a * share) * gp(Rbf(rho), K = 4)`: expected [ms] as declared, got [mV]";
    a_hyperparameters_prior: {
        param width [mm] ~ HalfNormal(1.0);
        field f(x) = m + a * gp(Rbf(rho), K = 4) where {
            m ~ Flat; a [ms] ~ HalfNormal(width); rho [mm] ~ InvGamma(1.0, 1.0);
        }
    } => "field f: `width`: expected [ms] like `a`, got [mm]";
    a_root: {
        param area [mm2] ~ HalfNormal(1.0);
        let side(row) [ms] = sqrt(area);
        observe y(row): Number ~ Normal(side(row), 1.0);
    } => "let side: `sqrt(area)`: expected [ms] as declared, got [mm]";
    a_power: {
        param side [mm] ~ HalfNormal(1.0);
        let area(row) [mm] = abs(pow(side, 2));
        observe y(row): Number ~ Normal(area(row), 1.0);
    } => "let area: `abs(pow(side, 2))`: expected [mm] as declared, got [mm2]";
    a_maximum: {
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        let longer(row) = max(t, d);
        observe y(row): Number ~ Normal(longer(row), 1.0);
    } => "let longer: `d`: expected [ms] like `t`, got [mm]";
    a_sum: {
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        let s(row) = t + d;
        observe y(row): Number ~ Normal(s(row), 1.0);
    } => "let s: `d`: expected [ms] like `t`, got [mm]";
    a_sum_within_a_users_function: {
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        let s(row) [ms] = a_users(t - d);
        observe y(row): Number ~ Normal(s(row), 1.0);
    } => "let s: `d`: expected [ms] like `t`, got [mm]";
    a_let_and_its_expression: {
        param speed [m/s] ~ Flat;
        column distance [mm];
        let arrival(row) [ms] = speed * row.distance;
        observe y(row): Number ~ Normal(arrival(row), 1.0);
    } => "let arrival: `speed * row.distance`: expected [ms] as declared, got [mm2/ms]";
    an_observed_let_whose_unit_follows: {
        param speed [m/s] ~ Flat;
        column distance [mm];
        let arrival(row) = speed.recip() * row.distance;
        observe y(row): Number [mm] ~ Normal(arrival(row), 1.0);
    } => "observe y: `arrival(row)`: expected [mm] like the measurement, got [ms]";
    a_compound_likelihood: {
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        observe y(row): Bracket [ms] ~ TopHat(t * 2.0 + d);
    } => "observe y: `d`: expected [ms] like the measurement, got [mm]";
    seconds_are_not_milliseconds: {
        param t [s] ~ Flat;
        observe y(row): Number [ms] ~ Normal(t, 1.0);
    } => "observe y: `t`: expected [ms] like the measurement, got [s]";
    a_noise_unlike_the_mean: {
        param t [ms] ~ Flat;
        param noise [mV] ~ HalfNormal(1.0);
        observe y(row): Number ~ Normal(t, noise);
    } => "observe y: `noise`: expected [ms] like `t`, got [mV]";
    a_floor_unlike_the_measurement: {
        param t [mV] ~ Flat;
        param low [ms] ~ Flat;
        observe y(row): Number [mV] ~ Censored(Normal(t, 1.0), low);
    } => "observe y: `low`: expected [mV] like the measurement, got [ms]";
    a_prior_of_another_unit: {
        param tau [mm] ~ HalfNormal(1.0);
        param b(3) [ms] ~ Normal(0.0, tau);
    } => "param b: `tau`: expected [ms] like `b`, got [mm]";
    a_rate: {
        param tau [ms] ~ HalfNormal(1.0);
        param t [ms] ~ Exponential(tau);
    } => "param t: `tau`: expected [1/ms] for a rate of what is in [ms], got [ms]";
    a_coefficient_times_its_column: {
        column force [g];
        param beta(1) [ms] ~ Flat;
        let push(row) [ms] = linear(row.force; beta);
        observe y(row): Number [ms] ~ Normal(push(row), 1.0);
    } => "let push: `beta * row.force`: expected [ms] as declared, got [ms·g]";
    an_effect_on_another_unit: {
        column force [g];
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        let a(row) [ms] = t;
        let b(row) [mm] = d;
        effect push on a, b [ms] = linear(row.force) ~ Normal(0.0, 1.0);
        observe y(row): Number [ms] ~ Normal(a(row), 1.0);
        observe z(row): Number [mm] ~ Normal(b(row), 1.0);
    } => "effect push: `b`: expected [ms] like the effect, got [mm]";
    a_density: {
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        density odd = ((t + d) / 3.0).powi(2) * -0.5;
    } => "density odd: `d`: expected [ms] like `t`, got [mm]";
    a_kernel_in_a_product: {
        field f(x) [ms] = m + a * gp(Rbf(rho) * Matern32(ell) + Rbf(rho), K = 4) where {
            m [ms] ~ Flat; a [ms] ~ HalfNormal(1.0); rho [mm] ~ InvGamma(1.0, 1.0); ell [ms] ~ InvGamma(1.0, 1.0);
        }
    } => "field f: `ell`: expected [mm] like every lengthscale, got [ms]";
    a_hyperparameter_of_a_block: {
        hyper smooth { m [mm] ~ Flat; a [ms] ~ HalfNormal(1.0); rho [mm] ~ InvGamma(1.0, 1.0); }
        field f(x, patient) [ms] = m + a * gp(Rbf(rho), K = 4) where shared smooth;
    } => "field f: `m`: expected [ms] as declared, got [mm]";
    a_prior_within_a_block: {
        param width [mm] ~ HalfNormal(1.0);
        hyper smooth { m [ms] ~ Flat; a [ms] ~ HalfNormal(width); rho [mm] ~ InvGamma(1.0, 1.0); }
        field f(x) [ms] = m + a * gp(Rbf(rho), K = 4) where smooth;
    } => "hyper smooth: `width`: expected [ms] like `a`, got [mm]";
    a_hyperparameter_of_each_label: {
        param centre [mm] ~ Flat;
        field f(x, patient) [ms] = m + a * gp(Rbf(rho), K = 4) where {
            m(patient) [ms] ~ Normal(centre, 1.0); a [ms] ~ HalfNormal(1.0); rho [mm] ~ InvGamma(1.0, 1.0);
        }
    } => "field f: `centre`: expected [ms] like `m`, got [mm]";
    a_column_with_empty_cells: {
        param d [mm] ~ HalfNormal(1.0);
        column dose [g] ~ Normal(5.0, d);
    } => "column dose: `d`: expected [g] like `dose`, got [mm]";
    a_vector_prior: {
        param d [mm] ~ HalfNormal(1.0);
        param cut(3) [ms] ~ Ordered(Normal(0.0, d));
    } => "param cut: `d`: expected [ms] like `cut`, got [mm]";
    a_part_of_a_mixture: {
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        observe y(row): Number [ms] ~ Mixture(0.5, Normal(t, 1.0), Normal(d, 1.0));
    } => "observe y: `d`: expected [ms] like the measurement, got [mm]";
}

no_mistakes! {
    functions_of_numbers: {
        param area [mm2] ~ HalfNormal(1.0);
        param ln_t ~ Flat;
        param p ~ Beta(1.0, 1.0);
        let side(row) [mm] = max(sqrt(area), 0.0) + min(pow(area, 0.5), sqrt(area));
        let t(row) [ms] = exp(ln_t) + ln(p) * pow(p, 2);
        observe y(row): Number ~ Normal(side(row), 1.0);
        observe z(row): Number [ms] ~ Normal(t(row), 1.0);
    };
    one_unit_written_in_two_ways: {
        param v [m/s] ~ Flat;
        observe y(row): Number [mm/ms] ~ Normal(v, 1.0);
    };
    products_and_quotients: {
        param d [mm] ~ HalfNormal(1.0);
        param t [ms] ~ HalfNormal(1.0);
        param diffusivity [mm2/ms] ~ HalfNormal(1.0);
        let v(row) [m/s] = d / t + (diffusivity / t).sqrt() - -(d * d / t).abs() / d + t.recip() * d;
        observe y(row): Number [m/s] ~ Normal(v(row), 1.0);
    };
    plain_numbers_in_sums_and_conversions: {
        param t [s] ~ HalfNormal(1.0);
        let late(row) [ms] = (t + 0.5) * 1000.0 + 20.0;
        observe y(row): Number [ms] ~ Normal(late(row), 1.0);
    };
    what_a_users_function_gives_is_as_declared: {
        param d [mm] ~ Flat;
        let t(row) [ms] = a_users(d);
        observe y(row): Number [ms] ~ Normal(t(row) + a_users(d).exp(), 1.0);
    };
    no_units_at_all: {
        field f(x) = m + a * gp(Rbf(rho), K = 4) where { m ~ Flat; a ~ HalfNormal(1); rho ~ InvGamma(1, 1); }
        observe y(x): Number ~ Normal(f(x), 1.0);
    };
    undeclared_units_beside_declared_ones: {
        param share ~ Beta(1.0, 1.0);
        param b ~ Flat;
        param t [ms] ~ Flat;
        let s(row) [mm] = t * share + b;
        observe y(row): Number [mm] ~ Normal(s(row), 1.0);
    };
    a_hyperparameter_hides_a_parameter_of_its_name: {
        param a [mm] ~ HalfNormal(1.0);
        field f(x) [ms] in 1..30 = m + a * gp(Rbf(rho), K = 4) where { m [ms] ~ Flat; a [ms] ~ HalfNormal(1.0); rho [mm] ~ InvGamma(1.0, 1.0); }
        observe y(x): Number [ms] ~ Normal(f(x), 1.0);
    };
    shapes_and_degrees_of_freedom_have_no_unit_to_share: {
        param nu [1] ~ Gamma(2.0, 0.1);
        param rate [1/ms] ~ HalfNormal(1.0);
        param scale [ms] ~ Gamma(nu, rate);
        param t [ms] ~ StudentT(nu, scale, scale);
        param log_normal [ms] ~ LogNormal(1.0, nu);
    };
    plain_numbers_that_stand_for_a_time: {
        column share [1];
        field f(x) [ms] = 200.0 + 3.0 * gp(Rbf(rho), K = 4) where { rho [mm] ~ InvGamma(1.0, 1.0); }
        let erp(x) [ms] = f(x) - f(x).recip() * f(x) * 5.0 + D::from(30.0) * x.share;
        let late(x) [ms] = (f(x) / f(x)) * 30.0;
        observe y(x): Number [ms] ~ Normal(erp(x) + late(x), 1.0);
    };
    a_percentage: {
        column scar [%];
        param slope [ms] ~ Flat;
        let delay(row) [ms] = slope * row.scar;
        observe y(row): Number [ms] ~ Normal(delay(row), 1.0);
    };
    comparisons_choose_between_equal_units: {
        param t [ms] ~ Flat;
        param d [mm] ~ Flat;
        let s(row) [ms] = if t < 3.0 { t } else { a_users(d) };
        observe y(row): Number [ms] ~ Normal(s(row), 1.0);
    };
    a_coefficient_per_gram: {
        column force [g];
        param beta(1) [ms/g] ~ Flat;
        let push(row) [ms] = linear(row.force; beta);
        observe y(row): Number [ms] ~ Normal(push(row), 1.0);
    };
    an_effect_in_its_targets_unit: {
        column force [g];
        param t [ms] ~ Flat;
        let a(row) [ms] = t;
        effect push on a [ms] = linear(row.force) ~ Normal(0, 10);
        observe y(row): Number [ms] ~ Normal(a(row), 1.0);
    };
    fields_of_labels_and_blocks: {
        hyper smooth { m [ms] ~ Flat; a [ms] ~ HalfNormal(1.0); rho [mm] ~ InvGamma(1.0, 1.0); }
        field f(x, patient) [ms] = m + a * gp(authors(Rbf(rho)) * Matern32(rho), K = 4) where shared smooth;
        field g(x) [ms] = m + a * gp(Rbf(rho), K = 4) where smooth { a [ms] ~ HalfNormal(2.0); }
        column dose [g] ~ Normal(5.0, 2.0);
        param slope [ms/g] ~ Flat;
        observe y(x): Number [ms] ~ Normal(f(x) - g(x) + slope * x.dose, 1.0);
    };
    numbers_on_the_left: {
        param t [ms] ~ Flat;
        let late(row) [ms] = 2 * t + 1.0 - t / 3;
        observe y(row): Number [ms] ~ Normal(late(row), 1.0);
    };
}
