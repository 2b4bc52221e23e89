//! Named arrays in named groups: what `posterior.zarr` holds.

/// One named array.
#[derive(Clone, Debug)]
pub struct Variable {
    /// Name, e.g. `tau_out.alpha`.
    pub name: String,
    /// Unit as declared in the model, empty if none.
    pub unit: String,
    /// Dimension names and lengths, outermost first, e.g. `[("chain", 4), ("draw", 1000), ("site", 10)]`.
    pub dims: Vec<(String, usize)>,
    /// Values in row-major order.
    pub values: Vec<f64>,
}

/// A group of variables that share dimensions, e.g. `posterior`.
#[derive(Clone, Debug)]
pub struct Group {
    /// Group name as ArviZ knows it.
    pub name: String,
    /// The arrays.
    pub variables: Vec<Variable>,
}
