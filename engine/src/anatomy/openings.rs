//! Which opening of a left atrium is which.

use super::AnatomyError;
use super::ways::Ways;
use crate::mesh::TriMesh;
use nalgebra::Vector3;
use std::fmt;

/// Smaller openings are holes, mm around.
const LEAST: f64 = 10.0;

/// An opening of a left atrium.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opening {
    /// The mitral valve.
    Mv,
    /// The left superior pulmonary vein.
    Lspv,
    /// The left inferior pulmonary vein.
    Lipv,
    /// The right superior pulmonary vein.
    Rspv,
    /// The right inferior pulmonary vein.
    Ripv,
}

impl Opening {
    /// All, in the order of [`Openings`].
    pub const ALL: [Self; 5] = [Self::Mv, Self::Lspv, Self::Lipv, Self::Rspv, Self::Ripv];
}

impl fmt::Display for Opening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mv => "mv",
            Self::Lspv => "lspv",
            Self::Lipv => "lipv",
            Self::Rspv => "rspv",
            Self::Ripv => "ripv",
        })
    }
}

/// The openings of a surface: the vertices around each, in order; the longest first. Counted from 1 they have the numbers
/// by which [`Openings::named`] and pictures know them.
pub fn openings(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let mut rings = mesh.boundary_loops();
    rings.sort_by(|a, b| around(mesh, b).total_cmp(&around(mesh, a)));
    rings
}

/// The length around an opening, mm.
pub fn around(mesh: &TriMesh, ring: &[u32]) -> f64 {
    let at = |v: u32| Vector3::from(mesh.vertices()[v as usize]);
    ring.iter().zip(ring.iter().cycle().skip(1)).map(|(a, b)| (at(*a) - at(*b)).norm()).sum()
}

/// The mean of the vertices around an opening, mm.
pub fn middle(mesh: &TriMesh, ring: &[u32]) -> Vector3<f64> {
    let sum: Vector3<f64> = ring.iter().map(|v| Vector3::from(mesh.vertices()[*v as usize])).sum();
    sum / ring.len() as f64
}

/// The vertices around each opening, in the order of [`Opening::ALL`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Openings([Vec<u32>; 5]);

impl Openings {
    /// The vertices around an opening, in order.
    pub fn of(&self, opening: Opening) -> &[u32] {
        &self.0[opening as usize]
    }

    /// As the user says: `mv=1,lspv=2,lipv=3,rspv=4,ripv=5` with the numbers of [`openings`].
    ///
    /// # Errors
    /// [`AnatomyError::Openings`] if it says something else.
    pub fn named(mesh: &TriMesh, given: &str) -> Result<Self, AnatomyError> {
        let wrong = |what: String| AnatomyError::Openings { given: given.into(), what };
        let all = openings(mesh);
        let mut found: [Option<usize>; 5] = [None; 5];
        for part in given.split(',') {
            let named = part.split_once('=').and_then(|(name, number)| {
                let name = name.trim().to_ascii_lowercase();
                let opening = Opening::ALL.into_iter().find(|o| o.to_string() == name)?;
                Some((opening, number.trim().parse::<usize>().ok()?))
            });
            let Some((opening, number)) = named else {
                return Err(wrong(format!("`{part}` is no opening and its number")));
            };
            if number == 0 || number > all.len() {
                return Err(wrong(format!(
                    "there is no opening {number}, expected 1 to {}",
                    all.len()
                )));
            }
            if found.contains(&Some(number)) || found[opening as usize].is_some() {
                return Err(wrong(format!("`{part}` is said of two")));
            }
            found[opening as usize] = Some(number);
        }
        let ring = |i: usize| match found[i] {
            Some(number) => Ok(all[number - 1].clone()),
            None => Err(wrong(format!("{} is missing", Opening::ALL[i]))),
        };
        Ok(Self([ring(0)?, ring(1)?, ring(2)?, ring(3)?, ring(4)?]))
    }

    /// By their places: the mitral valve is the longest, the veins of a side are near each other, the superior veins
    /// are farther from the valve than the inferior ones, and what is left and right follows from that, for an atrium is not
    /// its mirror image.
    ///
    /// # Errors
    /// [`AnatomyError::HowManyOpenings`] if there are not five that are large enough.
    pub fn guess(mesh: &TriMesh) -> Result<Self, AnatomyError> {
        let mut rings: Vec<Vec<u32>> =
            openings(mesh).into_iter().filter(|ring| around(mesh, ring) >= LEAST).collect();
        if rings.len() != 5 {
            return Err(AnatomyError::HowManyOpenings { n: rings.len(), least: LEAST });
        }
        let middles: Vec<Vector3<f64>> = rings.iter().map(|ring| middle(mesh, ring)).collect();
        let gap = |a: usize, b: usize| (middles[a] - middles[b]).norm();
        // two sides, and the superior vein of each, as if the first of a pair were that one
        let partner = [2, 3, 4].into_iter().min_by(|a, b| {
            let both = |other: usize| {
                let rest: Vec<usize> = [2, 3, 4].into_iter().filter(|i| *i != other).collect();
                gap(1, other) + gap(rest[0], rest[1])
            };
            both(*a).total_cmp(&both(*b))
        });
        let partner = partner.unwrap_or(2);
        let mut one = [1, partner];
        let mut other: Vec<usize> = [2, 3, 4].into_iter().filter(|i| *i != partner).collect();
        if gap(one[0], other[0]) + gap(one[1], other[1])
            > gap(one[0], other[1]) + gap(one[1], other[0])
        {
            other.reverse();
        }
        let ways = Ways::new(mesh);
        let far = |ring: usize| {
            ways.between(&rings[0], &rings[ring]).map_or(0.0, |way| ways.length(&way))
        };
        if far(one[0]) + far(other[0]) < far(one[1]) + far(other[1]) {
            one.reverse();
            other.reverse();
        }
        // from outside the left is left, where up is to the superior veins: then across × down points inwards
        let veins: Vector3<f64> = middles[1..].iter().sum::<Vector3<f64>>() / 4.0;
        let (across, down) =
            (middles[other[0]] - middles[one[0]], middles[one[1]] - middles[one[0]]);
        let (left, right) = if across.cross(&down).dot(&(veins - middles[0])) < 0.0 {
            ([one[0], one[1]], [other[0], other[1]])
        } else {
            ([other[0], other[1]], [one[0], one[1]])
        };
        let mut take = |i: usize| std::mem::take(&mut rings[i]);
        Ok(Self([take(0), take(left[0]), take(left[1]), take(right[0]), take(right[1])]))
    }
}
