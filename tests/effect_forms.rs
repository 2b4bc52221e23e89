//! Effects of every form: declared in a file or added to a model, they are the same; and `rewrite` writes that file.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "models/forms.rs"]
mod forms;
#[path = "models/outlying.rs"]
mod outlying;
#[path = "models/plain.rs"]
mod plain;
#[path = "models/scatter.rs"]
mod scatter_model;
#[path = "models/spread.rs"]
mod spread;
mod support;

use eplat::criticism::{Findings, rewrite};
use eplat::infer::LogDensity as _;
use eplat::model::forms::{
    above, all, family, group, logistic, saturating, scaled, scaled_by, smooth,
};
use eplat::model::{
    AddedEffect, Augmented, Declare, Discrepancy, Form, Model, RowError, Spread, equations,
};
use eplat::run::{Loaded, Problem};
use eplat::table::Measurements;
use rand::RngExt as _;
use support::{basis, rng, table};

/// One effect of each form, on the field, on the `let` and on both.
fn effects() -> Vec<AddedEffect> {
    let forms = [
        ("force", "erp", scaled("force_g", 1.5, 0.75)),
        ("curve", "late", smooth("force_g", 0.0, 3.0, 3.0)),
        ("catheter", "erp, late", group("catheter")),
        ("kind", "late", family("catheter")),
        ("local", "erp, late", scaled_by("force_g", "catheter", 1.5, 0.75)),
        ("force_curve", "late", saturating("force_g", 1.4)),
        ("patch", "erp", above("dist_mm", 12.0)),
        ("edge", "erp", logistic("dist_mm", 15.0, 2.5)),
        ("shift", "late", all()),
    ];
    let effect = |(name, on, form): (&str, &str, Form)| AddedEffect {
        name: name.into(),
        on: on.split(", ").map(String::from).collect(),
        unit: "ms".into(),
        form,
        sd: 10.0,
    };
    forms.into_iter().map(effect).collect()
}

/// Thirty rows; some cells of each covariate are empty.
fn rows() -> Measurements {
    let mut rng = rng(11);
    let mut line = |i: usize| {
        let (force, distance) = (rng.random_range(0.0..3.0), rng.random_range(0.0..30.0));
        let catheter = ["PV1", "PV2", "LAA", ""][i % 4];
        let force = if i == 5 { String::new() } else { f64::to_string(&force) };
        let (protocol, value) = [("s1s2", ""), ("direct", "12.5")][i % 2];
        format!("{protocol},{},200,210,{value},{force},{catheter},{distance}", 4 * i)
    };
    let lines: Vec<String> = (0..30).map(&mut line).collect();
    let header = "protocol,vertex,lower,upper,value,force_g,catheter,dist_mm";
    let mut data = table(header, &lines);
    data.place_at_indices(200).unwrap();
    data
}

/// Log density and gradient at three points.
fn densities(declared: &dyn Declare) -> Vec<(f64, Vec<f64>)> {
    densities_on(declared, &rows())
}

fn densities_on(declared: &dyn Declare, data: &Measurements) -> Vec<(f64, Vec<f64>)> {
    let basis = basis(200, 12);
    let model = Model::new(declared, Some(&basis), data).unwrap();
    let (mut evaluator, mut rng) = (model.evaluator(), rng(12));
    let mut one = |_| {
        let u: Vec<f64> = model.initial().iter().map(|u| u + rng.random_range(-0.5..0.5)).collect();
        let mut gradient = vec![0.0; u.len()];
        (evaluator.ln_density(&u, &mut gradient), gradient)
    };
    (0..3).map(&mut one).collect()
}

#[test]
fn the_file_that_rewrite_writes_is_the_augmented_model() {
    let why = |effect| (effect, "Added.".to_owned());
    let added: Vec<(AddedEffect, String)> = effects().into_iter().map(why).collect();
    let written = rewrite(
        include_str!("models/plain.rs"),
        &Findings { effects: added, ..Findings::default() },
    )
    .unwrap();
    assert_eq!(written, include_str!("models/forms.rs"));
    are_equal(&Augmented::new(&plain::Plain, &effects()), &forms::Plain);
}

#[test]
fn outliers_that_are_added_are_those_that_rewrite_writes() {
    let outliers = Some((0.1, 40.0));
    let written =
        rewrite(include_str!("models/plain.rs"), &Findings { outliers, ..Findings::default() })
            .unwrap();
    assert_eq!(written, include_str!("models/outlying.rs"));
    let augmented = Augmented::new(&plain::Plain, &[]).with_outliers(outliers);
    are_equal(&augmented, &outlying::Plain);
    assert_ne!(densities(&augmented), densities(&plain::Plain));
    let texts = |declared: &dyn Declare| -> Vec<String> {
        let model = Model::outline(declared).unwrap();
        let tree = model.syntax().unwrap();
        tree.observes().map(|observe| eplat_language::print(&observe.likelihood)).collect()
    };
    assert_eq!(texts(&augmented), texts(&outlying::Plain));
}

/// Two models have the same density and gradient.
fn are_equal(augmented: &dyn Declare, declared: &dyn Declare) {
    are_equal_on(augmented, declared, &rows());
}

fn are_equal_on(augmented: &dyn Declare, declared: &dyn Declare, data: &Measurements) {
    for ((ln, gradient), (ln_file, gradient_file)) in
        densities_on(augmented, data).iter().zip(densities_on(declared, data))
    {
        // a declared effect makes rows wider, and sums are then rounded in another order
        let is_equal = |a: f64, b: f64| (a - b).abs() <= 1e-11 * (1.0 + a.abs());
        assert!(ln.is_finite() && is_equal(*ln, ln_file), "{ln} {ln_file}");
        assert_eq!(gradient.len(), gradient_file.len());
        for (k, (a, b)) in gradient.iter().zip(gradient_file).enumerate() {
            assert!(is_equal(*a, b), "derivative {k}: {a} {b}");
        }
    }
}

#[test]
fn every_effect_matters() {
    let all = densities(&Augmented::new(&plain::Plain, &effects()));
    for left_out in 0..effects().len() {
        let mut fewer = effects();
        fewer.remove(left_out);
        let fewer = densities(&Augmented::new(&plain::Plain, &fewer));
        assert!(fewer[0].1.len() < all[0].1.len(), "effect {left_out} has no coefficient");
    }
    let mut other = effects();
    other[0].form = scaled("force_g", 1.5, 0.76);
    assert_ne!(densities(&Augmented::new(&plain::Plain, &other)), all);
}

/// A form of the file's own, made by a function of another module.
mod clock {
    use eplat::prelude::*;
    model! {
        model Clock;
        param mean ~ Normal(0, 10);
        let level(row) = mean;
        effect daily on level = own::periodic(row.hour, 24) ~ Normal(0, 5);
        observe y(row): Number ~ Normal(level(row), 0.5);
    }
    mod own {
        use eplat::prelude::*;
        #[derive(Debug)]
        struct Periodic(String, f64);
        pub(super) fn periodic(column: &str, period: f64) -> impl EffectForm + use<> {
            Periodic(column.into(), period)
        }
        impl EffectForm for Periodic {
            fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
                let angle = std::f64::consts::TAU / self.1;
                forms::of_number(table, &self.0, 2, |x| [(angle * x).cos(), (angle * x).sin()])
            }
            fn column(&self) -> Option<&str> {
                Some(&self.0)
            }
        }
    }
}

/// Over whole days cosine, sine and mean are orthogonal, so each mode is a conjugate normal's.
#[test]
fn the_coefficients_of_a_form_of_the_files_own_are_recovered() {
    let angle = |hour: usize| std::f64::consts::TAU * hour as f64 / 24.0;
    let y = |hour: usize| 3.0 + 2.0 * angle(hour).cos() - angle(hour).sin() + (hour % 5) as f64;
    let lines: Vec<String> = (0..48).map(|hour| format!("{},{hour}", y(hour))).collect();
    let measurements = table("y,hour", &lines);
    let problem = Problem::new(&clock::Clock, Loaded { measurements, ..Loaded::default() });
    let mode = problem.unwrap().mode().unwrap();
    let exact = |of: &dyn Fn(f64) -> f64| {
        let sum: f64 = (0..48).map(|hour| y(hour) * of(angle(hour))).sum();
        (sum / 0.25) / (24.0 / 0.25 + 1.0 / 25.0)
    };
    for (name, expected) in [("daily[0]", exact(&f64::cos)), ("daily[1]", exact(&f64::sin))] {
        let all = mode.parameters();
        let (_, found, _) = all.iter().find(|(own, ..)| own == name).unwrap();
        assert!((found - expected).abs() < 1e-5, "{name}: {found} {expected}");
    }
    // without the column there is no such effect
    let error = Model::new(&clock::Clock, None, &table("y", &["1".into()])).unwrap_err();
    assert!(error.to_string().contains("no column `hour`"), "{error}");
    let shown = equations(&Model::outline(&clock::Clock).unwrap());
    let line = "daily on level = own::periodic(row.hour, 24) ~ Normal(0, 5)";
    assert!(shown.contains(line), "{shown}");
}

/// The rows with other names in the header.
fn renamed(names: &[(&str, &str)]) -> Measurements {
    let rows = rows();
    let name = |own: &String| {
        let new = names.iter().find(|(old, _)| old == own);
        new.map_or(own.clone(), |(_, new)| (*new).to_owned())
    };
    let cells = |row: usize| rows.cells(row).into_iter().map(String::from).collect();
    let header = rows.columns().iter().map(name).collect();
    let cells = (0..rows.len()).map(cells).collect();
    let mut renamed = Measurements::from_cells("test", header, cells).unwrap();
    renamed.place_at_indices(200).unwrap();
    renamed
}

#[test]
fn a_column_whose_name_has_signs_is_read_without_them() {
    let table = renamed(&[("force_g", "force (g)")]);
    let mut found = effects();
    found[0].form = scaled("force (g)", 1.5, 0.75);
    found[1].form = smooth("force (g)", 0.0, 3.0, 3.0);
    let added: Vec<_> = found.iter().map(|e| (e.clone(), "Added.".to_owned())).collect();
    let written = rewrite(
        include_str!("models/plain.rs"),
        &Findings { effects: added, ..Findings::default() },
    )
    .unwrap();
    assert_eq!(written, include_str!("models/forms.rs"));
    assert_eq!(densities_on(&forms::Plain, &table), densities(&forms::Plain));
    are_equal_on(&Augmented::new(&plain::Plain, &found), &forms::Plain, &table);
    // where two columns would have the name, neither has it
    let two = renamed(&[("force_g", "force (g)"), ("dist_mm", "force/g")]);
    assert!(two.has("force (g)") && !two.has("force_g"));
    let error = Model::new(&forms::Plain, Some(&basis(200, 12)), &two).unwrap_err();
    assert!(error.to_string().contains("no column `force_g`"), "{error}");
    // nor is what has a meaning of its own found in this way
    assert!(!renamed(&[("force_g", "site (1)"), ("dist_mm", "%site")]).has("site"));
}

/// What catheters and brackets differ by.
fn discrepancy() -> Discrepancy {
    Discrepancy {
        spreads: vec![Spread {
            name: "catheter_difference".into(),
            sd: "catheter_sd".into(),
            prior_sd: 10.0,
            on: ["erp", "late"].map(String::from).to_vec(),
            unit: "ms".into(),
            form: group("catheter"),
            why: "Why sites.".into(),
        }],
        row_errors: vec![RowError {
            name: "row_error".into(),
            prior_sd: 10.0,
            unit: "ms".into(),
            observes: vec!["s1s2".into()],
            scatter: None,
            why: "Why rows.".into(),
        }],
    }
}

#[test]
fn a_discrepancy_that_is_added_is_the_one_that_rewrite_writes() {
    let (discrepancy, outliers) = (discrepancy(), Some((0.1, 40.0)));
    let findings = Findings { discrepancy: discrepancy.clone(), outliers, ..Findings::default() };
    let written = rewrite(include_str!("models/plain.rs"), &findings).unwrap();
    assert_eq!(written, include_str!("models/spread.rs"));
    let augmented =
        Augmented::new(&plain::Plain, &[]).with_discrepancy(discrepancy).with_outliers(outliers);
    are_equal(&augmented, &spread::Plain);
    // the equations too
    let shown = |declared: &dyn Declare| equations(&Model::outline(declared).unwrap());
    assert!(shown(&augmented).contains("Widened(Interval(erp(x), noise), row_error)"));
    assert!(shown(&augmented).contains("catheter_sd"), "{}", shown(&augmented));
}

/// The same, where the error of rows goes with their catheter; and that effect.
fn scatter() -> (Discrepancy, AddedEffect) {
    let mut discrepancy = discrepancy();
    discrepancy.row_errors[0].scatter = Some("ln_scatter".into());
    discrepancy.row_errors[0].observes = vec!["s1s2".into(), "direct".into()];
    let effect = AddedEffect {
        name: "hetero_catheter".into(),
        on: vec!["ln_scatter".into()],
        unit: String::new(),
        form: group("catheter"),
        sd: 1.0,
    };
    (discrepancy, effect)
}

#[test]
fn scatter_that_is_added_is_the_one_that_rewrite_writes() {
    let (discrepancy, effect) = scatter();
    let findings = Findings {
        discrepancy: discrepancy.clone(),
        effects: vec![(effect.clone(), "Why scatter.".into())],
        ..Findings::default()
    };
    let written = rewrite(include_str!("models/plain.rs"), &findings).unwrap();
    assert_eq!(written, include_str!("models/scatter.rs"));
    let augmented = Augmented::new(&plain::Plain, &[effect]).with_discrepancy(discrepancy);
    are_equal(&augmented, &scatter_model::Plain);
    let shown = equations(&Model::outline(&augmented).unwrap());
    assert!(shown.contains("row_error * exp(ln_scatter(x))"), "{shown}");
}

/// The gradient by differences: of the sd of an error of rows, of ln of its factor, and of the sd of
/// deviations.
#[test]
fn the_gradient_of_a_discrepancy_is_that_of_its_density() {
    let (discrepancy, effect) = scatter();
    let augmented = Augmented::new(&plain::Plain, &[effect]).with_discrepancy(discrepancy);
    let (basis, rows) = (basis(200, 12), rows());
    let model = Model::new(&augmented, Some(&basis), &rows).unwrap();
    let (mut evaluator, mut rng) = (model.evaluator(), rng(13));
    let n = model.dim();
    let u: Vec<f64> = model.initial().iter().map(|u| u + rng.random_range(-0.5..0.5)).collect();
    let (mut gradient, mut other) = (vec![0.0; n], vec![0.0; n]);
    evaluator.ln_density(&u, &mut gradient);
    for i in 0..n {
        let mut at = |step: f64| {
            let mut u = u.clone();
            u[i] += step;
            evaluator.ln_density(&u, &mut other)
        };
        let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
        let name = &model.unknown_names()[i];
        assert!(
            (slope - gradient[i]).abs() < 1e-5 * (1.0 + slope.abs()),
            "{name}: {slope} {}",
            gradient[i]
        );
    }
}

/// What the language knows as a form ships as one, or `models/forms.rs` would not compile.
#[test]
fn every_form_of_the_vocabulary_is_declared_in_a_test() {
    let declared = [
        include_str!("models/forms.rs"),
        include_str!("models/language.rs"),
        include_str!("loop_paths.rs"),
    ];
    for shape in eplat_language::vocabulary::FORMS {
        let text = format!(" = {}(row", shape.name);
        assert!(declared.iter().any(|file| file.contains(&text)), "{}", shape.name);
    }
}
