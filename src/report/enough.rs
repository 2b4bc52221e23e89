//! Whether there are enough draws, asked while a run samples.

use std::io;

use rayon::prelude::*;

use super::verdict::is_settled;
use crate::diagnostics::summarise;
use crate::infer::Chain;
use crate::model::Model;
use crate::random::Stream;

/// Whether R̂ and effective sample size of every parameter are those of a converged run; `seed` is the run's.
///
/// # Errors
/// From the disk that the draws are on.
pub(crate) fn has_enough(model: &Model, chains: &[&Chain], seed: u64) -> io::Result<bool> {
    let of_chain = |(i, chain): (usize, &&Chain)| {
        let (mut tape, mut rng) = (model.tape(), Stream::AfterSampling(i).rng(seed));
        let (mut columns, mut row) = (vec![vec![]; model.n_reported()], vec![]);
        chain.draws.each(1, |_, draw| {
            model.forward_parameters(&mut tape, draw);
            row.clear();
            model.report(&tape, &mut rng, &mut row);
            columns.iter_mut().zip(&row).for_each(|(column, x)| column.push(*x));
            io::Result::Ok(())
        })?;
        Ok(columns)
    };
    let columns: io::Result<Vec<Vec<Vec<f64>>>> =
        chains.par_iter().enumerate().map(of_chain).collect();
    let columns = columns?;
    let is_settled = |i: usize| {
        let own: Vec<&[f64]> = columns.iter().map(|chain| chain[i].as_slice()).collect();
        is_settled(&summarise(&own))
    };
    Ok((0..model.n_reported()).into_par_iter().all(is_settled))
}
