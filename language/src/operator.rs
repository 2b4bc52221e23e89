//! Operators over the whole surface, as they are written.

#![allow(
    missing_debug_implementations,
    reason = "syn's expressions have none without a feature that costs seconds to build"
)]

use syn::{Expr, Ident};

use crate::print::print;

/// An operator over the whole surface, `WORD(OPERAND, …; row.source, row.source2 + LATER)`. Its operands have a value at every
/// place.
pub struct Operator {
    /// Which.
    pub operation: Operation,
    /// Its operands, at least one.
    pub operands: Vec<Expr>,
    /// The column that holds the vertex at which activation starts.
    pub source: Option<Ident>,
    /// Of one of the file's own: the function that makes it, and its numbers.
    pub own: Option<(syn::Path, Vec<Expr>)>,
    /// Columns with vertices at which the same activation starts too, and by how much later.
    pub further: Vec<(Ident, Expr)>,
}

/// The operators over the whole surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// When an activation that starts at the row's source arrives. Operands: slowness along the fibres, then, as far as
    /// they are written, the ratio of velocities along and across the fibres, the angle by which fibres are turned
    /// from those of the mesh, and the thickness of fronts.
    Eikonal,
    /// The integral of an expression along the geodesic from the row's source.
    Path,
    /// How steep an expression is.
    Gradient,
    /// One of the file's own.
    Own,
}

impl Operation {
    /// Those that ship.
    pub const SHIPPED: [Self; 3] = [Self::Eikonal, Self::Path, Self::Gradient];

    /// The word that calls it; empty of one of the file's own.
    pub fn word(self) -> &'static str {
        match self {
            Self::Eikonal => "eikonal",
            Self::Path => "path",
            Self::Gradient => "gradient",
            Self::Own => "",
        }
    }

    /// What its operands are; the first must be written.
    pub fn operands(self) -> &'static [&'static str] {
        match self {
            Self::Eikonal => &["a slowness", "a ratio of velocities", "an angle", "a thickness"],
            Self::Path | Self::Gradient | Self::Own => &["an expression"],
        }
    }

    /// Whether it has a source.
    pub fn has_source(self) -> bool {
        matches!(self, Self::Eikonal | Self::Path)
    }
}

impl Operator {
    /// As a person would write it, of a row of this name.
    pub fn text(&self, row: &Ident) -> String {
        let operands: Vec<String> = self.operands.iter().map(print).collect();
        let source = self.source.as_ref().map_or(String::new(), |at| format!("; {row}.{at}"));
        let further = self.further.iter().map(|(at, e)| format!(", {row}.{at} + {}", print(e)));
        let further: String = further.collect();
        let operands = operands.join(", ");
        let Some((function, numbers)) = &self.own else {
            return format!("{}({operands}{source}{further})", self.operation.word());
        };
        let numbers: Vec<String> = numbers.iter().map(print).collect();
        let blank = if numbers.is_empty() { "" } else { " " };
        format!("{}({operands};{blank}{})", print(function), numbers.join(", "))
    }

    /// All expressions in it.
    pub fn exprs(&self) -> impl Iterator<Item = &Expr> {
        self.operands.iter().chain(self.further.iter().map(|(_, later)| later))
    }
}
