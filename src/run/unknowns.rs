//! `unknowns.npz`: draws as the sampler saw them, from which a later run starts and predictions are made.
//!
//! ```text
//! draws (n, unknown)   chain (n): from 0   about: UTF-8 of {"model": …, "unknowns": [name, …]}
//! corrected_at (n, unknown): draws in whose mean arrival times are those of finer triangles, in a model of such times
//! ```

use std::io::{self, Seek, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::fit::Fit;
use crate::report::ReportError;
use crate::store::{NpzReader, NpzWriter, Packing, write_file};

/// The file in an output folder.
pub(super) const FILE: &str = "unknowns.npz";

/// The array that only models of arrival times have.
const CORRECTED: &str = "corrected_at";

/// Whose draws they are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct About {
    /// The model.
    pub(super) model: String,
    /// Names of the unknowns.
    pub(super) unknowns: Vec<String>,
}

/// Draws of a run by the names of its unknowns.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Unknowns {
    pub(super) about: About,
    /// `(chain, draw, unknown)`.
    pub(super) chains: Vec<Vec<Vec<f64>>>,
    /// See [`Model::corrected_at`](crate::model::Model::corrected_at).
    pub(super) corrected_at: Vec<Vec<f64>>,
}

impl Unknowns {
    pub(super) fn new(fit: &Fit<'_>) -> Self {
        let model = fit.model();
        let about = About { model: model.name.into(), unknowns: model.unknown_names() };
        let each = fit.kept.len() / fit.chains().len().max(1);
        let chains = fit.kept.chunks_exact(each.max(1));
        let chains = chains.map(<[Vec<f64>]>::to_vec).collect();
        Self { about, chains, corrected_at: model.corrected_at() }
    }

    /// # Errors
    /// [`ReportError::Write`].
    pub(super) fn write(&self, path: &Path) -> Result<(), ReportError> {
        write_file(path, |file| self.write_arrays(file))
            .map_err(|source| ReportError::Write { path: path.to_owned(), source })
    }

    fn write_arrays(&self, writer: impl Write + Seek) -> io::Result<()> {
        let chain = self.chains.iter().enumerate();
        let chain: Vec<i64> = chain.flat_map(|(i, draws)| vec![i as i64; draws.len()]).collect();
        let draws: Vec<f64> = self.chains.iter().flatten().flatten().copied().collect();
        let about = serde_json::to_vec(&self.about)?;
        let shape = [chain.len() as u64, self.about.unknowns.len() as u64];
        let mut archive = NpzWriter::new(writer, Packing::Stored);
        archive.array("draws", &shape, &draws)?;
        archive.array("chain", &shape[..1], &chain)?;
        archive.array("about", &[about.len() as u64], &about)?;
        if let Some(first) = self.corrected_at.first() {
            let shape = [self.corrected_at.len(), first.len()].map(|n| n as u64);
            archive.array(CORRECTED, &shape, &self.corrected_at.concat())?;
        }
        archive.finish()
    }

    /// Reads what [`Unknowns::write`] wrote.
    ///
    /// # Errors
    /// [`ReportError::Read`], [`ReportError::Malformed`].
    pub(super) fn read(path: &Path) -> Result<Self, ReportError> {
        let unread = |source| ReportError::Read { path: path.to_owned(), source };
        let malformed = |reason: String| ReportError::Malformed { path: path.to_owned(), reason };
        let mut archive = NpzReader::open(path).map_err(unread)?;
        let is_corrected = archive.names().map_err(unread)?.iter().any(|name| name == CORRECTED);
        let wrong = |error: io::Error| malformed(error.to_string());
        let mut values = |name| archive.array(name).map(|array| array.values).map_err(wrong);
        let about: Vec<u8> = values("about")?.into_iter().map(|byte| byte as u8).collect();
        let about: About = serde_json::from_slice(&about).map_err(|e| malformed(e.to_string()))?;
        let (chain, draws) = (values("chain")?, values("draws")?);
        let corrected_at = if is_corrected { values(CORRECTED)? } else { vec![] };
        let width = about.unknowns.len();
        if !corrected_at.len().is_multiple_of(width) {
            let got = corrected_at.len();
            return Err(malformed(format!(
                "`{CORRECTED}`: expected draws of {width} numbers, got {got} numbers"
            )));
        }
        let corrected_at = corrected_at.chunks(width.max(1)).map(<[f64]>::to_vec).collect();
        if draws.len() != chain.len() * width || draws.is_empty() {
            let (n, got) = (chain.len(), draws.len());
            return Err(malformed(format!(
                "expected {n} draws of {width} numbers, got {got} numbers"
            )));
        }
        let mut chains: Vec<Vec<Vec<f64>>> = vec![];
        for (of, draw) in chain.into_iter().zip(draws.chunks_exact(width)) {
            let (of, n) = (of as usize, chains.len());
            match chains.last_mut() {
                Some(own) if of + 1 == n => own.push(draw.to_vec()),
                _ if of == n => chains.push(vec![draw.to_vec()]),
                _ => return Err(malformed(format!("expected chain {n}, got chain {of}"))),
            }
        }
        Ok(Self { about, chains, corrected_at })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_chains() -> Unknowns {
        let unknowns = vec!["mean".to_owned(), "ln sd".to_owned()];
        let chains = vec![vec![vec![1.0, 0.1], vec![2.0, -0.2]], vec![vec![1.0 / 3.0, 7.0]]];
        let corrected_at = vec![vec![1.5, -0.1], vec![1.25, 0.3]];
        Unknowns { about: About { model: "M".into(), unknowns }, chains, corrected_at }
    }

    #[test]
    fn draws_read_back_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        two_chains().write(&path).unwrap();
        assert_eq!(Unknowns::read(&path).unwrap(), two_chains());
    }

    #[test]
    fn what_does_not_fit_together_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        let refused = |unknowns: &Unknowns| {
            unknowns.write(&path).unwrap();
            Unknowns::read(&path).unwrap_err().to_string()
        };
        let none = refused(&Unknowns { chains: vec![], ..two_chains() });
        assert!(none.contains("expected 0 draws of 2 numbers, got 0 numbers"), "{none}");
        let short = refused(&Unknowns { corrected_at: vec![vec![1.5]], ..two_chains() });
        assert!(
            short.contains("`corrected_at`: expected draws of 2 numbers, got 1 numbers"),
            "{short}"
        );
        std::fs::write(&path, "not an archive").unwrap();
        assert!(Unknowns::read(&path).is_err());
        assert!(Unknowns::read(&folder.path().join("none.npz")).is_err());
    }
}
