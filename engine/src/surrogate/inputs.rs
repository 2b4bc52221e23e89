//! The parameters of the cell as inputs of surrogates: which of them vary in a design, and which
//! values the others have.

use super::design::latin_hypercube;
use crate::ep::Parameters;
use crate::ep::cell::RANGES;
use crate::ep::table::rounded;

/// Number of parameters.
pub const N_INPUTS: usize = RANGES.len();

/// Places of `cv_max`, `tau_out` and `apd_max` in [`RANGES`]. These vary in the design of the ERP
/// surrogates.
///
/// # Source
/// Coveney et al. 2022, Methods, "surrogate functions"
pub const ERP_INPUTS: [usize; 3] = [0, 2, 4];

/// The value of each parameter where it does not vary, in the order of [`RANGES`]. `tau_in` and
/// `tau_open` are the paper's; the others are near the middle of their ranges.
pub const NOMINAL: [f64; N_INPUTS] = [0.7, 0.05, 10.0, 120.0, 200.0];

/// The place in [`RANGES`] of the parameter `name`.
pub fn input(name: &str) -> Option<usize> {
    RANGES.iter().position(|range| range.0 == name)
}

/// The valid range of the parameter at place `i`.
pub fn input_range(i: usize) -> (f64, f64) {
    (RANGES[i].2, RANGES[i].3)
}

/// `n` parameter sets that vary the parameters at the places `vary` over their valid ranges.
pub fn design_points(n: usize, vary: &[usize], seed: u64) -> Vec<Parameters> {
    let ranges: Vec<(f64, f64)> = vary.iter().map(|&i| input_range(i)).collect();
    let parameters = |point: Vec<f64>| {
        let mut values = NOMINAL;
        for (&i, value) in vary.iter().zip(point) {
            values[i] = rounded(value, 1e6);
        }
        Parameters::from_array(values)
    };
    latin_hypercube(n, &ranges, seed).into_iter().map(parameters).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_varies_stays_in_its_valid_range_and_the_rest_is_nominal() {
        for (vary, fixed) in [(&ERP_INPUTS[..], vec![1, 3]), (&[0, 1, 2, 3, 4], vec![])] {
            for parameters in design_points(50, vary, 4) {
                assert_eq!(parameters.validate(), Ok(()));
                let values = parameters.to_array();
                assert!(fixed.iter().all(|&i| values[i].to_bits() == NOMINAL[i].to_bits()));
            }
        }
        assert_eq!((input("tau_out"), input("tau_oui")), (Some(2), None));
    }
}
