//! The plan of a validation study: a grid of calibrations on synthetic truth, as a TOML file.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::StudyError;
use crate::experiment::Minutes;
use crate::mesh::{self, Surface, Units};

/// Edge length of the embedded atrium, mm.
const ATRIUM_EDGE: f64 = 1.5;

/// What is calibrated how often. Every case is one value of each list, one truth and one design.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The file.
    #[serde(skip)]
    path: PathBuf,
    /// Model file, relative to the plan.
    pub model: PathBuf,
    /// Surface mesh, relative to the plan; the embedded left atrium without it.
    pub mesh: Option<PathBuf>,
    /// Unit of the mesh's coordinates.
    pub units: Option<String>,
    /// Seed of truths and designs.
    #[serde(default = "one")]
    pub seed: u64,
    /// Lengthscales of the true fields, mm.
    pub lengthscales: Vec<f64>,
    /// Numbers of measurement sites; with `minutes`, as long a time as these take.
    pub sites: Vec<usize>,
    /// Widths of a bracket, in the unit of the measurement.
    pub resolutions: Vec<f64>,
    /// Truths of each lengthscale.
    pub fields: usize,
    /// Designs of each number of sites.
    pub designs: usize,
    /// Distance that sites keep from openings, mm.
    #[serde(default = "six")]
    pub exclude: f64,
    /// How sites are chosen.
    #[serde(default)]
    pub choice: Choice,
    /// How long measurements take: [`Choice::Next`] goes by what is learnt per minute, and may measure
    /// one protocol alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minutes: Option<Minutes>,
    /// What the calibration says: the posterior's mode, or its mean from draws.
    #[serde(default)]
    pub estimate: Estimate,
    /// Chains of each calibration by draws.
    #[serde(default = "four")]
    pub chains: usize,
    /// Warm-up transitions of each chain.
    #[serde(default = "draws")]
    pub warmup: usize,
    /// Draws of each chain.
    #[serde(default = "draws")]
    pub draws: usize,
}

/// What a calibration is judged by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Estimate {
    /// The mode of the density, as the paper's validation.
    #[default]
    Mode,
    /// Mean and intervals of posterior draws.
    Mean,
}

/// How sites are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Choice {
    /// All at once, far from each other.
    #[default]
    Maximin,
    /// The fewest so, then one after the other where the draws so far say that it teaches most (per
    /// minute, if it is said what takes how long).
    Next,
}

fn one() -> u64 {
    1
}
fn four() -> usize {
    4
}
fn six() -> f64 {
    6.0
}
fn draws() -> usize {
    500
}

/// One truth, and all cases on it: what one result file holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Its number in the plan, from 0.
    pub index: usize,
    /// Lengthscale of the truth, mm.
    pub lengthscale: f64,
    /// Number of the truth, from 0.
    pub field: usize,
}

/// One calibration on a block's truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Number of sites.
    pub sites: usize,
    /// Number of the design, from 0.
    pub design: usize,
    /// Width of a bracket.
    pub resolution: f64,
}

/// The most cases of a study: years of a large machine, and a table that can still be read.
const MOST_CASES: u128 = 10_000_000;

impl Plan {
    /// Reads and checks a plan.
    ///
    /// # Errors
    /// [`StudyError::Plan`], with line and column where the text is at fault.
    pub fn read(path: &Path) -> Result<Self, StudyError> {
        let fault = |why: String| StudyError::Plan { path: path.to_owned(), why };
        let text = std::fs::read_to_string(path).map_err(|error| fault(error.to_string()))?;
        let plan: Self = toml::from_str(&text)
            .map_err(|error| fault(format!("\n{}", error.to_string().trim_end())))?;
        plan.check().map_err(fault)?;
        Ok(Self { path: path.to_owned(), ..plan })
    }

    /// The plan's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A path of the plan, which is relative to its folder.
    pub fn beside(&self, path: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(path)
    }

    /// The surface.
    ///
    /// # Errors
    /// [`StudyError::Plan`] for an unknown unit, [`StudyError::Mesh`].
    pub fn surface(&self) -> Result<Surface, StudyError> {
        let Some(path) = &self.mesh else { return Ok(Surface::left_atrium(ATRIUM_EDGE)) };
        let units = self.units.as_deref().map(Units::from_str).transpose();
        let units = units.map_err(|why| self.fault(format!("units: {why}")))?;
        Ok(mesh::read(&self.beside(path), units)?)
    }

    /// The error that this plan is wrong.
    pub(super) fn fault(&self, why: String) -> StudyError {
        StudyError::Plan { path: self.path.clone(), why }
    }

    fn check(&self) -> Result<(), String> {
        let positive = |name: &str, values: &[f64]| match values {
            [] => Err(format!("{name} is empty\nhelp: give at least one value")),
            _ if values.iter().all(|x| *x > 0.0 && x.is_finite()) => Ok(()),
            _ => Err(format!("{name} {values:?}: expected positive numbers")),
        };
        positive("lengthscales", &self.lengthscales)?;
        positive("resolutions", &self.resolutions)?;
        let sites: Vec<f64> = self.sites.iter().map(|n| *n as f64).collect();
        positive("sites", &sites)?;
        let counts = [self.fields, self.designs, self.chains, self.warmup, self.draws];
        if counts.contains(&0) {
            return Err("fields, designs, chains, warmup and draws are 1 or more".to_owned());
        }
        let [lengthscales, sites, resolutions] =
            [self.lengthscales.len(), self.sites.len(), self.resolutions.len()];
        let factors = [lengthscales, self.fields, sites, self.designs, resolutions];
        let n = factors.iter().fold(1_u128, |product, n| product.saturating_mul(*n as u128));
        if n > MOST_CASES {
            return Err(format!(
                "{n} cases: a study has at most {MOST_CASES}\nhelp: they are lengthscales × fields × sites × designs × resolutions: make one of these smaller"
            ));
        }
        if self.exclude.is_nan() || self.exclude < 0.0 {
            return Err(format!("exclude {}: expected a distance in mm", self.exclude));
        }
        if self.choice == Choice::Next && self.estimate == Estimate::Mode {
            return Err("choice = \"next\" needs estimate = \"mean\": it goes by draws".to_owned());
        }
        if self.minutes.is_some() && self.choice == Choice::Maximin {
            return Err(
                "minutes without choice = \"next\": sites chosen at once are measured whole"
                    .to_owned(),
            );
        }
        if self.mesh.is_none() && self.units.is_some() {
            return Err("units without a mesh".to_owned());
        }
        Ok(())
    }

    /// All blocks, in the order of their results.
    pub fn blocks(&self) -> Vec<Block> {
        let pairs = self.lengthscales.iter().flat_map(|l| (0..self.fields).map(move |f| (*l, f)));
        let block = |(index, (lengthscale, field))| Block { index, lengthscale, field };
        pairs.enumerate().map(block).collect()
    }

    /// The cases of every block, in the order of their results.
    pub fn cases(&self) -> Vec<Case> {
        let mut cases = vec![];
        for &sites in &self.sites {
            for design in 0..self.designs {
                let case = |resolution: &f64| Case { sites, design, resolution: *resolution };
                cases.extend(self.resolutions.iter().map(case));
            }
        }
        cases
    }

    /// Seed of a block's truth: the same whatever else the plan has.
    pub(super) fn truth_seed(&self, block: &Block) -> u64 {
        self.seed_of(&format!("truth {} {}", block.lengthscale, block.field))
    }

    /// Seed of a design: the same for all truths.
    pub(super) fn design_seed(&self, case: &Case) -> u64 {
        self.seed_of(&format!("design {} {}", case.sites, case.design))
    }

    /// Seed of a calibration.
    pub(super) fn case_seed(&self, block: &Block, case: &Case) -> u64 {
        let Block { lengthscale, field, .. } = block;
        let Case { sites, design, resolution } = case;
        self.seed_of(&format!("case {lengthscale} {field} {sites} {design} {resolution}"))
    }

    fn seed_of(&self, what: &str) -> u64 {
        let digest = Sha256::digest(format!("{} {what}", self.seed));
        digest.iter().take(8).fold(0, |seed, byte| seed << 8 | u64::from(*byte))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Plan, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        let name = file.path().display().to_string();
        Plan::read(file.path()).map_err(|error| error.to_string().replace(&name, "plan.toml"))
    }

    const SMALL: &str = "model = \"erp.rs\"\nlengthscales = [32, 64]\nsites = [5, 10]\nresolutions = [10.0]\nfields = 3\ndesigns = 2\n";

    #[test]
    fn a_plan_has_a_block_for_each_truth_and_the_same_cases_in_each() {
        let plan = read(SMALL).unwrap();
        let blocks = plan.blocks();
        assert_eq!(blocks.len(), 6);
        assert_eq!(blocks[4], Block { index: 4, lengthscale: 64.0, field: 1 });
        assert_eq!(plan.cases().len(), 4);
        let seeds: std::collections::BTreeSet<u64> =
            blocks.iter().map(|block| plan.truth_seed(block)).collect();
        assert_eq!(seeds.len(), 6);
    }

    #[test]
    fn truths_and_designs_stay_when_the_plan_grows() {
        let small = read(SMALL).unwrap();
        let large = read(&SMALL.replace("[32, 64]", "[20, 32, 64]")).unwrap();
        assert_eq!(small.truth_seed(&small.blocks()[4]), large.truth_seed(&large.blocks()[7]));
        assert_eq!(small.design_seed(&small.cases()[3]), large.design_seed(&large.cases()[3]));
    }

    #[test]
    fn mistakes_are_told_with_their_place() {
        let said = [
            read(&SMALL.replace("fields", "field")),
            read(&SMALL.replace("[10.0]", "[0.0]")),
            read(&SMALL.replace("[5, 10]", "[]")),
            read(&SMALL.replace("designs = 2", "designs = 0")),
            read(&format!("{SMALL}units = \"inch\"\n")),
            read(&format!("{SMALL}estimate = \"map\"\n")),
        ];
        let said: Vec<String> = said.into_iter().map(|plan| plan.unwrap_err()).collect();
        insta::assert_snapshot!(said.join("\n\n"));
    }
}
