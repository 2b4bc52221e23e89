//! What a strip did.

use thiserror::Error;

/// What one conditioning beat did in the middle of the strip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beat {
    /// Conduction velocity, m/s (= mm/ms).
    pub cv: f64,
    /// Action potential duration at 20 % recovery, ms; absent where V did not rise above 0.8.
    pub apd20: Option<f64>,
    /// At 30 % recovery, ms.
    pub apd30: Option<f64>,
    /// At 50 % recovery, ms.
    pub apd50: Option<f64>,
    /// At 90 % recovery, ms.
    pub apd90: f64,
}

/// Why a quantity has no value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Absence {
    /// A conditioning stimulus did not activate every node.
    #[error("the conditioning stimulus did not activate the whole strip")]
    NoActivation,
    /// A conditioned beat did not recover everywhere within S1.
    #[error("the conditioned beat did not recover within S1")]
    NoRecovery,
    /// The shortest interval already captures.
    #[error("the shortest interval already captures")]
    AlwaysCaptures,
    /// The longest interval still fails.
    #[error("the longest interval still fails")]
    NeverCaptures,
}

/// Everything one parameter set yields; an ERP is the largest whole interval (ms) that fails.
#[derive(Debug, Clone, PartialEq)]
pub struct StripOutcome {
    /// The last S1 beat.
    pub s1: Result<Beat, Absence>,
    /// ERP under S1S2, ms.
    pub erp_s2: Result<u32, Absence>,
    /// The conditioning S2 beat of S1S2S3.
    pub s2: Result<Beat, Absence>,
    /// ERP under S1S2S3, ms.
    pub erp_s3: Result<u32, Absence>,
    /// The S2 beats of the protocol's restitution curve: interval (ms) and what they did.
    pub restitution: Vec<(u32, Result<Beat, Absence>)>,
}
