//! Made-up mapping studies on a known truth: 40 sites, brackets of 10 ms, covariates of which some, one or
//! none act.
//!
//! The truth has none of the forms that `eplat loop` tries: Matérn fields of 128 modes against the model's 24,
//! a force that saturates, a warm-up for a drift, the restitution of the cell for the rate, strength–interval
//! curves for the output, a change of two parameters at once for region and patch, soft at its edge.
//! What acts has a standard deviation of 8 ms over the sites.
#![allow(clippy::unwrap_used, reason = "for tests")]
#![allow(dead_code, reason = "each test uses a part of it")]
#![allow(clippy::doc_markdown, clippy::manual_is_multiple_of, reason = "for tests")]

use std::fmt::Write as _;

use eplat::field::{Matern52, unit_field};
use eplat::manifold::{Basis, Geodesic, eigenpairs_cached, maximin};
use eplat::mesh::{Atrium, left_atrium};
use eplat::surrogate::{erp_s2, erp_s3};
use eplat::table::Measurements;
use rand::seq::SliceRandom as _;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Standard deviation of what acts, ms.
pub(crate) const EFFECT: f64 = 8.0;
const N_TRAIN: usize = 40;
/// As many as the reference sets hold out: with 20 the errors before and after differ by chance too often.
const N_HELDOUT: usize = 60;
/// What a study takes, min.
const DURATION: f64 = 60.0;

/// What acts, and what is wrong with the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scenario {
    Null,
    Force,
    Catheter,
    Drift,
    Rate,
    Output,
    Wall,
    Outliers,
    Region,
    Patch,
    /// Force and catheter.
    Two,
    /// A catheter that goes with the operator.
    Confounded,
    /// A catheter of its own in the veins.
    ConfoundedRegion,
    /// Something that no column tells.
    Outside,
    /// Nothing; half of the sites are in the table twice.
    Repeated,
    /// Force, of which a third of the cells is empty; the temperature is mostly so.
    Missing,
    /// Force, in mN in one of four sessions.
    Misscaled,
    /// Force and output, which cancel: the operator turns the output up with the force.
    Cancel,
    /// Sessions one after the other that differ; catheter, operator and temperature are constant in each.
    Decoys,
    /// Region, which changes two fields, and force, which changes what is observed.
    TwoLevels,
    /// Force and catheter, each twice as large.
    TwoLarge,
    /// Scatter that grows as the force falls.
    Hetero,
    /// Scatter of one catheter.
    HeteroCatheter,
    /// Force, which acts in the veins alone; its mean there is no other than elsewhere.
    Interaction,
    /// A third field, which moves ERP_S3 alone. It is not among [`ALL`]: the loop does not try it.
    Third,
}

pub(crate) const ALL: [Scenario; 24] = {
    use Scenario::*;
    [
        Null,
        Force,
        Catheter,
        Drift,
        Rate,
        Output,
        Wall,
        Outliers,
        Region,
        Patch,
        Two,
        Confounded,
        ConfoundedRegion,
        Outside,
        Repeated,
        Missing,
        Misscaled,
        Cancel,
        Decoys,
        TwoLevels,
        TwoLarge,
        Hetero,
        HeteroCatheter,
        Interaction,
    ]
};

/// The surface that all studies share.
pub(crate) struct Heart {
    atrium: Atrium,
    /// 128 modes.
    pub(crate) basis: Basis,
    geodesic: Geodesic,
}

impl Heart {
    pub(crate) fn new() -> Self {
        let atrium = left_atrium(2.0);
        let basis = eigenpairs_cached(&atrium.mesh, 128).unwrap();
        let geodesic = Geodesic::new(&atrium.mesh).unwrap();
        Self { atrium, basis, geodesic }
    }
}

/// A study's two tables, and the truth behind the first.
pub(crate) struct Study {
    pub(crate) train: Measurements,
    pub(crate) heldout: Measurements,
    pub(crate) truth: Truth,
}

/// What nobody knows of the sites for training, in their order.
pub(crate) struct Truth {
    /// Lengthscale of both fields, mm.
    pub(crate) lengthscale: f64,
    /// What is added to both ERPs, ms.
    pub(crate) shift: Vec<f64>,
    /// What a region of its own changes of `tau_out` and `apd_max`, or would change if it acted, ms.
    pub(crate) change: Vec<[f64; 2]>,
    /// Standard deviation of a further error that grows as the force falls, or what it would be if there were one, ms.
    pub(crate) scatter: Vec<f64>,
}

/// Mean and standard deviation of the true fields, `tau_out` and `apd_max`, ms.
pub(crate) const FIELDS: [(f64, f64); 2] = [(9.0, 2.5), (190.0, 14.0)];
/// Standard deviation of a measurement's error, ms.
pub(crate) const ERROR: f64 = 2.0;

/// A site and how it was measured.
#[derive(Clone, Debug)]
struct Site {
    name: usize,
    vertex: u32,
    minute: f64,
    session: usize,
    catheter: &'static str,
    operator: &'static str,
    output: f64,
    force: f64,
    wall: f64,
    fibre: f64,
    region: &'static str,
    scar: f64,
    impedance: f64,
    temperature: f64,
    s1: f64,
    /// `tau_out` and `apd_max`, ms.
    parameters: [f64; 2],
    /// What is added to the ERP, ms.
    shift: f64,
    /// Standard deviation of a further error of each measurement, ms.
    scatter: f64,
    /// What is added to the ERP of S1S2S3, ms.
    third: f64,
}

const REGIONS: [&str; 7] = ["body", "PV1", "PV2", "PV3", "PV4", "LAA", "body"];

impl Site {
    fn is_vein(&self) -> bool {
        self.region.starts_with("PV")
    }

    /// Shortening of the action potential at S1 < ∞: the inactivation gate has not recovered, ms.
    fn restitution(&self) -> f64 {
        const TAU_OPEN: f64 = 120.0;
        const TAU_CLOSE: f64 = 45.0;
        let rest = self.s1 - self.parameters[1] - 30.0;
        TAU_CLOSE * (1.0 - (-rest / TAU_OPEN).exp()).ln()
    }
}

/// Draws the study number `seed` of a scenario.
pub(crate) fn study(heart: &Heart, scenario: Scenario, seed: u64) -> Study {
    let mut rng = ChaCha8Rng::seed_from_u64(1000 * seed + scenario as u64);
    let (mut sites, lengthscale) = sites(heart, &mut rng);
    rearrange(&mut sites, scenario, &mut rng);
    let mut changed = sites.clone();
    remodel(&mut changed, |s| f64::from(u8::from(s.is_vein())));
    let own = sites.iter().zip(&changed).take(N_TRAIN);
    let change = own.map(|(a, b)| [0, 1].map(|k| b.parameters[k] - a.parameters[k])).collect();
    spread(&mut changed, |s| force(s).powi(2));
    let scatter = changed.iter().take(N_TRAIN).map(|site| site.scatter).collect();
    act(&mut sites, scenario, &mut rng);
    if scenario == Scenario::Third {
        let eta: Vec<f64> = (0..24).map(|_| rng.sample(StandardNormal)).collect();
        let unit = unit_field(&heart.basis, &Matern52(40.0), &eta);
        for site in &mut sites {
            site.third = EFFECT * unit[site.vertex as usize];
        }
    }
    let (train, heldout) = sites.split_at(N_TRAIN);
    let shift = train.iter().map(|site| site.shift).collect();
    let [train, heldout] = [train, heldout].map(|own| table(own, scenario, heart, &mut rng));
    Study { train, heldout, truth: Truth { lengthscale, shift, change, scatter } }
}

/// Sites with fields and covariates under which nothing acts, those for training first; and the lengthscale of the fields.
fn sites(heart: &Heart, rng: &mut ChaCha8Rng) -> (Vec<Site>, f64) {
    let mut vertices = maximin(&heart.atrium.mesh, N_TRAIN, 6.0, rng.random()).unwrap();
    while vertices.len() < N_TRAIN + N_HELDOUT {
        let vertex = rng.random_range(0..heart.basis.n_vertices()) as u32;
        if !vertices.contains(&vertex) {
            vertices.push(vertex);
        }
    }
    let lengthscale = 18.0 * rng.random_range(0.0f64..1.0).exp();
    let [tau_out, apd_max] = FIELDS.map(|(mean, sd)| {
        let eta: Vec<f64> =
            (0..heart.basis.n_modes()).map(|_| rng.sample(StandardNormal)).collect();
        let unit = unit_field(&heart.basis, &Matern52(lengthscale), &eta);
        vertices.iter().map(|v| mean + sd * unit[*v as usize]).collect::<Vec<f64>>()
    });
    let centre = rng.random_range(0..heart.basis.n_vertices()) as u32;
    let scar = heart.geodesic.distance(&[centre]);
    let n = vertices.len();
    let mut minutes: Vec<f64> =
        (0..n).map(|i| DURATION * (i as f64 + rng.random::<f64>()) / n as f64).collect();
    minutes.shuffle(rng);
    let one = |(i, vertex): (usize, &u32)| Site {
        name: i,
        vertex: *vertex,
        minute: minutes[i],
        session: rng.random_range(0..4),
        catheter: ["A", "B", "C"][rng.random_range(0..3)],
        operator: ["op1", "op2"][rng.random_range(0..2)],
        output: [2.0, 3.0, 5.0, 8.0][rng.random_range(0..4)],
        force: 12.0 * (0.45 * rng.sample::<f64, _>(StandardNormal)).exp(),
        wall: rng.random_range(1.2..3.6),
        fibre: rng.random_range(-180.0..180.0),
        region: REGIONS[heart.atrium.region[*vertex as usize] as usize],
        scar: scar[*vertex as usize],
        impedance: 120.0 + 6.0 * rng.sample::<f64, _>(StandardNormal),
        temperature: 37.0 + 0.3 * rng.sample::<f64, _>(StandardNormal),
        s1: [400.0, 500.0, 600.0, 700.0][rng.random_range(0..4)],
        parameters: [tau_out[i].clamp(2.5, 18.0), apd_max[i].clamp(150.0, 235.0)],
        shift: 0.0,
        scatter: 0.0,
        third: 0.0,
    };
    (vertices.iter().enumerate().map(one).collect(), lengthscale)
}

/// Covariates that go together.
fn rearrange(sites: &mut [Site], scenario: Scenario, rng: &mut ChaCha8Rng) {
    for site in sites {
        match scenario {
            Scenario::Confounded => {
                (site.catheter, site.operator) =
                    [("A", "op1"), ("B", "op2")][rng.random_range(0..2)];
            }
            Scenario::ConfoundedRegion => {
                site.catheter = if site.is_vein() { "B" } else { "A" };
            }
            Scenario::Cancel => {
                let order = site.force + rng.random_range(-2.0..2.0);
                site.output =
                    [2.0, 3.0, 5.0, 8.0][[8.0, 12.0, 17.0].partition_point(|f| *f < order)];
            }
            Scenario::Decoys => {
                site.session = (4.0 * site.minute / DURATION) as usize;
                site.catheter = ["A", "B", "A", "C"][site.session];
                site.operator = ["op1", "op2", "op2", "op1"][site.session];
                site.temperature = 36.6 + 0.2 * site.session as f64;
            }
            _ => {}
        }
    }
}

/// What a contact force does to a measurement: less, the more there is of it.
fn force(site: &Site) -> f64 {
    (-site.force / 12.0).exp()
}

/// Lets the scenario's causes act.
fn act(sites: &mut [Site], scenario: Scenario, rng: &mut ChaCha8Rng) {
    let labels: [f64; 4] = std::array::from_fn(|_| rng.sample::<f64, _>(StandardNormal));
    let order = rng.random_bool(0.5);
    let catheter = |s: &Site| match s.catheter {
        "A" => 0.0,
        "B" => 1.0,
        _ => {
            if order {
                2.0
            } else {
                -1.0
            }
        }
    };
    let output = |s: &Site| -s.output.ln();
    let mut scar: Vec<f64> = sites[..N_TRAIN].iter().map(|s| s.scar).collect();
    scar.sort_by(f64::total_cmp);
    let edge = scar[rng.random_range(N_TRAIN / 5..N_TRAIN * 2 / 5)];
    match scenario {
        Scenario::Force | Scenario::Missing | Scenario::Misscaled => add(sites, 1.0, force),
        Scenario::Catheter | Scenario::Confounded | Scenario::ConfoundedRegion => {
            add(sites, 1.0, catheter);
        }
        Scenario::Two => {
            add(sites, 1.0, force);
            add(sites, 1.0, catheter);
        }
        Scenario::TwoLarge => {
            add(sites, 2.0, force);
            add(sites, 2.0, catheter);
        }
        Scenario::TwoLevels => {
            remodel(sites, |s| f64::from(u8::from(s.is_vein())));
            add(sites, 1.0, force);
        }
        Scenario::Cancel => {
            add(sites, 1.0, force);
            add(sites, 1.0, |s| -output(s));
        }
        Scenario::Hetero => spread(sites, |s| force(s).powi(2)),
        Scenario::HeteroCatheter => spread(sites, |s| f64::from(u8::from(s.catheter == "C"))),
        Scenario::Interaction => {
            let own: Vec<Site> = sites[..N_TRAIN].iter().filter(|s| s.is_vein()).cloned().collect();
            let (mean, _) = moments(&own, &force);
            add(sites, 1.0, |s| if s.is_vein() { force(s) - mean } else { 0.0 });
        }
        Scenario::Drift => add(sites, 1.0, |s| -(-s.minute / 20.0).exp()),
        Scenario::Rate => add(sites, 1.0, Site::restitution),
        Scenario::Output => add(sites, 1.0, output),
        Scenario::Wall => add(sites, 1.0, |s| s.wall.sqrt()),
        Scenario::Decoys => add(sites, 1.0, |s| labels[s.session]),
        Scenario::Outside => {
            let hidden: Vec<f64> = sites.iter().map(|_| rng.sample(StandardNormal)).collect();
            for (site, hidden) in sites.iter_mut().zip(hidden) {
                site.shift += EFFECT * hidden;
            }
        }
        Scenario::Region => remodel(sites, |s| f64::from(u8::from(s.is_vein()))),
        Scenario::Patch => remodel(sites, |s| 1.0 / (1.0 + ((s.scar - edge) / 1.5).exp())),
        Scenario::Null | Scenario::Outliers | Scenario::Repeated | Scenario::Third => {}
    }
}

/// Adds `cause` to the ERP, with [`EFFECT`] times `size` for its standard deviation over the sites for training.
fn add(sites: &mut [Site], size: f64, cause: impl Fn(&Site) -> f64) {
    let (mean, sd) = moments(&sites[..N_TRAIN], &cause);
    for site in sites {
        site.shift += size * EFFECT * (cause(site) - mean) / sd;
    }
}

/// Gives measurements a further error whose sd goes with `cause`; its root mean square over the sites for training
/// is [`EFFECT`].
fn spread(sites: &mut [Site], cause: impl Fn(&Site) -> f64) {
    let square = |s: &Site| cause(s).powi(2);
    let rms = moments(&sites[..N_TRAIN], &square).0.sqrt();
    for site in sites {
        site.scatter = EFFECT * cause(site) / rms;
    }
}

/// Shortens the action potential and quickens repolarisation where `tissue` is 1.
fn remodel(sites: &mut [Site], tissue: impl Fn(&Site) -> f64) {
    let erp = |p: [f64; 2]| erp_s2(p[0], p[1]);
    let (_, sd) = moments(&sites[..N_TRAIN], &tissue);
    for site in sites {
        let (p, change) = (site.parameters, EFFECT / sd * tissue(site));
        let at = |share: f64| [p[0] * (1.0 - 0.4 * share), p[1] * (1.0 - 0.25 * share)];
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if erp(p) - erp(at(middle)) < change { low = middle } else { high = middle }
        }
        site.parameters = at(low);
    }
}

fn moments(sites: &[Site], of: &impl Fn(&Site) -> f64) -> (f64, f64) {
    let n = sites.len() as f64;
    let mean = sites.iter().map(of).sum::<f64>() / n;
    (mean, (sites.iter().map(|s| (of(s) - mean).powi(2)).sum::<f64>() / n).sqrt())
}

const HEADER: &str = "site,vertex,protocol,S1,S2,resolution,lower,upper,t_min,catheter,operator,session,output_mA,force_g,wall_mm,fibre_deg,region,dist_scar_mm,impedance_ohm,temperature_C";

/// The sites' rows, S1S2 and S1S2S3, in brackets whose grid begins anywhere.
fn table(sites: &[Site], scenario: Scenario, heart: &Heart, rng: &mut ChaCha8Rng) -> Measurements {
    let mut lines = vec![];
    for (i, site) in sites.iter().enumerate() {
        let [tau_out, apd_max] = site.parameters;
        let erps = [erp_s2(tau_out, apd_max), erp_s3(tau_out, apd_max)];
        let grid = rng.random_range(0.0..10.0f64).floor();
        let visit = Visit { site, number: i, grid, scenario };
        let own: Vec<String> = (0..2).map(|k| visit.row(k, erps[k], rng)).collect();
        lines.extend(own.iter().cloned());
        if scenario == Scenario::Repeated && i % 2 == 0 {
            lines.extend(own);
        }
    }
    let cells = |line: &String| line.split(',').map(String::from).collect();
    let header = HEADER.split(',').map(String::from).collect();
    let rows = lines.iter().map(cells).collect();
    let mut table = Measurements::from_cells("made", header, rows).unwrap();
    table.place_at_indices(heart.basis.n_vertices()).unwrap();
    table
}

/// A site as it is measured.
struct Visit<'a> {
    site: &'a Site,
    number: usize,
    /// Where the brackets' grid begins, ms.
    grid: f64,
    scenario: Scenario,
}

impl Visit<'_> {
    /// The row of protocol number `protocol`, in which the refractory period is `erp` ms.
    fn row(&self, protocol: usize, erp: f64, rng: &mut ChaCha8Rng) -> String {
        let Self { site, number, grid, scenario } = *self;
        let mut error = ERROR * rng.sample::<f64, _>(StandardNormal);
        if scenario == Scenario::Outliers && rng.random_bool(0.1) {
            error += 40.0 * rng.sample::<f64, _>(StandardNormal);
        }
        if site.scatter > 0.0 {
            error += site.scatter * rng.sample::<f64, _>(StandardNormal);
        }
        let third = if protocol == 1 { site.third } else { 0.0 };
        let shown = erp + site.shift + third + error;
        let lower = grid + ((shown - grid) / 10.0).floor() * 10.0;
        let is_absent = |share| scenario == Scenario::Missing && share;
        let force = match scenario {
            Scenario::Missing if number % 3 == 1 => String::new(),
            Scenario::Misscaled if site.session == 2 => format!("{:.4}", 9.81 * site.force),
            _ => format!("{:.4}", site.force),
        };
        let temperature = if is_absent(!number.is_multiple_of(4)) {
            String::new()
        } else {
            format!("{:.3}", site.temperature)
        };
        let wall = site.wall + 0.1 * rng.sample::<f64, _>(StandardNormal);
        let mut line = String::new();
        let (name, s2) = [("S1S2", ""), ("S1S2S3", "300")][protocol];
        let _ = write!(
            line,
            "{},{},{name},{},{s2},10,{lower},{}",
            site.name,
            site.vertex,
            site.s1,
            lower + 10.0
        );
        let _ = write!(
            line,
            ",{:.3},{},{},s{}",
            site.minute, site.catheter, site.operator, site.session
        );
        let _ = write!(line, ",{},{force},{wall:.3},{:.2}", site.output, site.fibre);
        let _ =
            write!(line, ",{},{:.3},{:.2},{temperature}", site.region, site.scar, site.impedance);
        line
    }
}
