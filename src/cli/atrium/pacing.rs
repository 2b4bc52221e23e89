//! Where and when a surface is paced, as the command line says it.

use clap::Args;
use serde::Serialize;

use crate::ep::surface::Pacing;
use crate::error::Failure;
use crate::mesh::{Refined, Surface};

#[derive(Debug, Args, Serialize)]
pub(super) struct PacingArgs {
    /// Vertices that are paced together, counted from 0 as in the file
    #[arg(
        long,
        value_name = "VERTEX",
        value_delimiter = ',',
        required_unless_present = "pace_region"
    )]
    pace: Vec<usize>,
    /// Pace all vertices at which point data have this value, such as region=6, the embedded atrium's
    /// mitral rim
    #[arg(long, value_name = "NAME=VALUE", value_parser = named_value, conflicts_with = "pace")]
    pace_region: Option<(String, f64)>,
    /// Vertices closer than this to one of --pace are stimulated with it, mm
    #[arg(long, value_name = "MM", default_value_t = 3.0)]
    radius: f64,
    /// Interval of the S1 train, ms
    #[arg(long, value_name = "MS", default_value_t = 600.0)]
    s1: f64,
    /// Beats of the S1 train
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Intervals of further stimuli, ms: S2, S3 and so on; any train is --beats 1 and its intervals
    #[arg(long, value_name = "MS", value_delimiter = ',')]
    extra: Vec<f64>,
    /// Strength of the stimuli, 1/ms
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    strength: f64,
    /// Beat that is measured, from 1; the last without it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    measure: Option<u32>,
    /// How long the last beat is followed, ms
    #[arg(long, value_name = "MS", default_value_t = 600.0)]
    last: f64,
}

fn named_value(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let value = value.parse().map_err(|_| format!("expected a number after =, got {value:?}"))?;
    Ok((name.into(), value))
}

impl PacingArgs {
    /// On the refined mesh of `surface`.
    pub(super) fn pacing(&self, surface: &Surface, refined: &Refined) -> Result<Pacing, Failure> {
        let is_paced = match &self.pace_region {
            Some((name, value)) => region(name, *value, surface, refined)?,
            None => self.discs(surface, refined)?,
        };
        let mut times: Vec<f64> = (0..self.beats).map(|beat| f64::from(beat) * self.s1).collect();
        for interval in &self.extra {
            times.push(times.last().map_or(0.0, |last| last + interval));
        }
        Ok(Pacing {
            vertices: (0..).zip(is_paced).filter(|(_, paced)| *paced).map(|(v, _)| v).collect(),
            end: times.last().map_or(0.0, |last| last + self.last),
            strength: self.strength,
            measured: self.measure.map_or(times.len(), |beat| beat as usize) - 1,
            times,
        })
    }

    /// Which vertices are near one of --pace.
    fn discs(&self, surface: &Surface, refined: &Refined) -> Result<Vec<bool>, Failure> {
        let mut is_paced = vec![false; refined.mesh.n_vertices()];
        for source in &self.pace {
            let centre = surface.vertex_of_source(*source).ok_or_else(|| {
                Failure::new(format_args!(
                    "--pace {source} is no vertex of the surface, which has {}\nhelp: vertices are counted from 0",
                    surface.n_source_vertices
                ))
            })?;
            let centre = surface.mesh.vertices()[centre as usize];
            for (is_paced, p) in is_paced.iter_mut().zip(refined.mesh.vertices()) {
                let square: f64 = (0..3).map(|k| (p[k] - centre[k]).powi(2)).sum();
                *is_paced |= square <= self.radius * self.radius;
            }
        }
        Ok(is_paced)
    }
}

/// Which vertices are in a region; of the new ones those between two of its vertices.
fn region(
    name: &str,
    value: f64,
    surface: &Surface,
    refined: &Refined,
) -> Result<Vec<bool>, Failure> {
    let Some(field) = surface.point_data.get(name) else {
        let has: Vec<&str> = surface.point_data.keys().map(String::as_str).collect();
        return Err(Failure::new(format_args!(
            "--pace-region {name}={value}: the surface has no point data {name}; it has: {}\n\
             help: give one of these names, or vertices with --pace",
            has.join(", ")
        )));
    };
    let is_in: Vec<bool> = field.iter().map(|x| (x - value).abs() < 1e-9).collect();
    if !is_in.contains(&true) {
        let mut values = field.clone();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values.truncate(12);
        return Err(Failure::new(format_args!(
            "--pace-region {name}={value}: no vertex has this value; the lowest are {values:?}\n\
             help: give one that occurs"
        )));
    }
    Ok(refined.carry(is_in, |a, b| a && b))
}
