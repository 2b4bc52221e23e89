//! *Physical*, *informed* and *trusted*: the posterior over the surface and in its parameters.

use serde::{Deserialize, Serialize};

use super::Colour;

/// A larger share outside the declared ranges is amber. With five sites a right model has up to
/// 0.29.
const UNPHYSICAL: f64 = 0.35;
/// A larger share is red: most of the posterior lies where the model means nothing.
const MOSTLY_UNPHYSICAL: f64 = 0.5;
/// A field that is informed on a smaller share of the surface than this was not learnt about, not
/// even near a site.
const UNINFORMED: f64 = 0.01;
/// It is amber if a larger share of the surface than this is too far from every site.
const TOO_FAR: f64 = 0.5;

/// A share of something with a name, from 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// What it is of.
    pub name: String,
    /// The share.
    pub share: f64,
}

/// Fields and derived quantities against their declared ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Physical {
    /// Share of (vertex, draw) pairs at which any of them is outside.
    pub outside: f64,
    /// For each map that declares a range, the share at which it is outside.
    pub maps: Vec<Share>,
    /// Share of vertices at which every draw is outside.
    pub void: f64,
}

impl Physical {
    /// Red where most of the posterior means nothing.
    pub fn colour(&self) -> Colour {
        match self.outside {
            x if x > MOSTLY_UNPHYSICAL => Colour::Red,
            x if x > UNPHYSICAL => Colour::Amber,
            _ => Colour::Green,
        }
    }
}

/// The posterior against the prior.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Informed {
    /// For each field, the share of the surface on which it is informed: its 90 % interval is at
    /// most half as wide as before the measurements. The width before is that of its prior or nine
    /// tenths of its declared range, whichever is less.
    pub fields: Vec<Share>,
    /// Parameters whose 90 % interval is hardly narrower than their prior's.
    pub uninformed: Vec<String>,
    /// How many parameters were compared with their prior.
    pub n_parameters: usize,
}

impl Informed {
    /// Amber where a field, or every parameter of a model without fields, is as it was before.
    pub fn colour(&self) -> Colour {
        let is_nothing_learnt = if self.fields.is_empty() {
            self.n_parameters > 0 && self.uninformed.len() == self.n_parameters
        } else {
            self.fields.iter().any(|field| field.share < UNINFORMED)
        };
        if is_nothing_learnt { Colour::Amber } else { Colour::Green }
    }
}

/// How much of the surface lies too far from every site for one field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reach {
    /// The field.
    pub field: String,
    /// Posterior median of its longest lengthscale, mm.
    pub lengthscale: f64,
    /// Share of the surface farther than this from every site.
    pub beyond: f64,
}

/// The surface against the sites.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trusted {
    /// Each field with a lengthscale.
    pub fields: Vec<Reach>,
    /// Largest distance of a vertex from every site, mm.
    pub farthest: f64,
}

impl Trusted {
    /// The field that reaches least far.
    pub fn worst(&self) -> Option<&Reach> {
        self.fields.iter().max_by(|a, b| a.beyond.total_cmp(&b.beyond))
    }

    /// Amber where most of a field's map is extrapolated.
    pub fn colour(&self) -> Colour {
        let is_far = self.worst().is_some_and(|reach| reach.beyond > TOO_FAR);
        if is_far { Colour::Amber } else { Colour::Green }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_threshold_turns_the_colour() {
        let physical = |outside| Physical { outside, maps: vec![], void: 0.0 }.colour();
        assert_eq!([0.055, 0.4, 0.771].map(physical), [Colour::Green, Colour::Amber, Colour::Red]);
        let share = |share| Share { name: "f".to_owned(), share };
        let informed = |fields: Vec<Share>, n_uninformed: usize| {
            let uninformed = vec![String::new(); n_uninformed];
            Informed { fields, uninformed, n_parameters: 4 }.colour()
        };
        assert_eq!(informed(vec![share(0.9), share(0.005)], 0), Colour::Amber);
        assert_eq!(informed(vec![share(0.9), share(0.3)], 4), Colour::Green);
        assert_eq!([3, 4].map(|n| informed(vec![], n)), [Colour::Green, Colour::Amber]);
        let reach = |beyond| Reach { field: "f".to_owned(), lengthscale: 20.0, beyond };
        let trusted = |worst| Trusted { fields: vec![reach(0.0), reach(worst)], farthest: 9.0 };
        assert_eq!([0.4, 0.6].map(|x| trusted(x).colour()), [Colour::Green, Colour::Amber]);
    }
}
