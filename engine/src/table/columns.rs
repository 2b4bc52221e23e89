//! What the columns of a table mean: the one place where names of columns are known.
//!
//! [`Columns`] gives every column a [`Role`]. Names that are not known are covariates; a user can give
//! any column another role ([`Columns::with`], on the command line `eplat loop --column NAME=ROLE`).

use std::fmt;
use std::str::FromStr;

/// The column that names the site of a row.
pub const SITE: &str = "site";
/// The column that holds a row's vertex (index in the mesh file).
pub const VERTEX: &str = "vertex";
/// The column that names the `observe` statement of a row.
pub const PROTOCOL: &str = "protocol";
/// The column that holds, for each row, the vertex (index in the mesh file) at which activation starts.
pub const SOURCE: &str = "source";

/// Whether a column holds further vertices at which activation starts: `source2`, `source3`, ….
pub(super) fn is_further_source(name: &str) -> bool {
    let number = name.strip_prefix(SOURCE).and_then(|rest| rest.parse::<u32>().ok());
    number.is_some_and(|number| number >= 2)
}

/// The column that is then added: length of the geodesic path from there, mm.
pub const PATH: &str = "path_mm";
/// Quantities that the export of a mapping system has for every point; `protocol` names them.
pub const EXPORTED: [&str; 3] = ["bipolar", "unipolar", "lat"];
/// The columns that hold what was measured, whatever the model.
pub const MEASURED: [&str; 3] = ["lower", "upper", "value"];

/// What a column means to the search for missing effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Anything that may tell why measurements differ: numbers or labels.
    Covariate,
    /// A distance to something. Tissue nearer to it than a threshold may be a patch of its own.
    Distance,
    /// When a row was measured. A covariate whose effect is a drift.
    Time,
    /// Names of regions of the surface. Tissue of one region may differ in every field.
    Region,
    /// Which recording, session, heart, … a row belongs to: rows that share more than a site.
    Unit,
    /// Rows that cross-validation leaves out together.
    Fold,
    /// Where and how a row was measured, or the result. Never a cause.
    Structural,
}

impl Role {
    /// Every role with its name on the command line.
    pub const ALL: [(&'static str, Self); 7] = [
        ("covariate", Self::Covariate),
        ("distance", Self::Distance),
        ("time", Self::Time),
        ("region", Self::Region),
        ("unit", Self::Unit),
        ("fold", Self::Fold),
        ("structural", Self::Structural),
    ];

    /// Whether a column of this role may be a cause.
    pub fn is_cause(self) -> bool {
        !matches!(self, Self::Structural | Self::Fold)
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let own = Self::ALL.iter().find(|(_, role)| role == self);
        f.write_str(own.map_or("covariate", |(name, _)| name))
    }
}

impl FromStr for Role {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let own = Self::ALL.iter().find(|(name, _)| *name == text);
        own.map(|(_, role)| *role).ok_or_else(|| {
            let names: Vec<&str> = Self::ALL.iter().map(|(name, _)| *name).collect();
            format!("no role `{text}`: a column is one of {}", names.join(", "))
        })
    }
}

/// Columns that say where and how a row was measured, or hold the result.
pub(super) const STRUCTURAL: [&str; 12] = [
    SITE,
    VERTEX,
    PROTOCOL,
    SOURCE,
    PATH,
    "x",
    "y",
    "z",
    "resolution",
    MEASURED[0],
    MEASURED[1],
    MEASURED[2],
];

/// Words for an occasion: a column is a unit if this is its whole name or is followed by one of [`NUMBERED`].
const UNITS: [&str; 13] = [
    "session",
    "rec",
    "recording",
    "heart",
    "patient",
    "subject",
    "animal",
    "day",
    "date",
    "run",
    "study",
    "case",
    "map",
];

/// What may follow the word of a unit: `rec_id` names recordings, `run_order` does not name runs.
const NUMBERED: [&str; 5] = ["id", "no", "nr", "name", "label"];

/// The roles of columns: known names, and what a user says of others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Columns {
    /// What the user says, which goes first.
    given: Vec<(String, Role)>,
}

impl Columns {
    /// The same with another role for one column.
    #[must_use]
    pub fn with(mut self, name: &str, role: Role) -> Self {
        self.given.retain(|(given, _)| given != name);
        self.given.push((name.into(), role));
        self
    }

    /// The role of a column.
    pub fn role(&self, name: &str) -> Role {
        let given = self.given.iter().find(|(given, _)| given == name);
        given.map_or_else(|| known(name), |(_, role)| *role)
    }

    /// The columns to which a user has given a role.
    pub fn given(&self) -> impl Iterator<Item = &str> {
        self.given.iter().map(|(name, _)| name.as_str())
    }
}

/// The role that a name has by itself.
fn known(name: &str) -> Role {
    if STRUCTURAL.contains(&name) || is_further_source(name) {
        return Role::Structural;
    }
    let lower = name.to_lowercase();
    let (word, rest) = lower.split_once('_').unwrap_or((&lower, "id"));
    match word {
        "fold" if name == "fold" => Role::Fold,
        "region" if name == "region" => Role::Region,
        "t" | "time" => Role::Time,
        _ if name.starts_with("dist") => Role::Distance,
        _ if UNITS.contains(&word) && NUMBERED.contains(&rest) => Role::Unit,
        _ => Role::Covariate,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_roles_and_a_user_may_say_otherwise() {
        let columns = Columns::default();
        let roles = ["dist_scar_mm", "t_min", "region", "session_id", "fold", "site", "force_g"];
        let expected = [
            Role::Distance,
            Role::Time,
            Role::Region,
            Role::Unit,
            Role::Fold,
            Role::Structural,
            Role::Covariate,
        ];
        assert_eq!(roles.map(|name| columns.role(name)), expected);
        assert_eq!(columns.role("run_order"), Role::Covariate);
        let columns = columns.with("wall", Role::Distance).with("wall", Role::Unit);
        assert_eq!(columns.role("wall"), Role::Unit);
        assert_eq!(columns.given().count(), 1);
    }

    #[test]
    fn a_role_is_read_as_it_is_written() {
        for (name, role) in Role::ALL {
            assert_eq!((name.parse(), role.to_string()), (Ok(role), name.to_owned()));
        }
        assert!("recording".parse::<Role>().unwrap_err().contains("distance, time, region"));
    }
}
