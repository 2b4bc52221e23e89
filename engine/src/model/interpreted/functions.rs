//! The functions that an expression may call.

use crate::dist::{ln_gamma, ln_logistic, logistic};
use crate::num::{Num, Real};
use crate::surrogate::{self, emulated, five};

/// One number for each lane. (`array::from_fn` is not inlined, and then costs more than most steps.)
#[inline(always)]
pub(super) fn each<T: Real, const L: usize>(of: impl Fn(usize) -> Num<T>) -> [Num<T>; L] {
    let mut out = [Num::from(0.0); L];
    for (lane, out) in out.iter_mut().enumerate() {
        *out = of(lane);
    }
    out
}

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(non_camel_case_types, reason = "as they are written")]
pub(super) enum Unary {
    neg,
    method(Method),
    logistic,
    ln_logistic,
    ln_gamma,
}

macro_rules! methods {
    ($($name:ident)*) => {
        /// A method of a number.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[allow(non_camel_case_types, reason = "as they are written")]
        pub(super) enum Method { $($name),* }

        impl Method {
            /// That of this name.
            pub(super) fn of(name: &str) -> Option<Self> {
                match name {
                    $(stringify!($name) => Some(Self::$name),)*
                    _ => None,
                }
            }

            #[inline(always)]
            fn at<D: Real>(self, x: D) -> D {
                match self { $(Self::$name => x.$name()),* }
            }
        }
    };
}
methods! {
    recip sqrt cbrt exp exp2 exp_m1 ln log2 log10 ln_1p sin cos tan asin acos atan sinh cosh tanh
    asinh acosh atanh abs signum
}

/// Methods that are functions, too: `exp(x)`.
const FREE: [&str; 9] = ["abs", "cos", "exp", "ln", "log10", "sin", "sqrt", "tan", "tanh"];

impl Unary {
    /// The function of this name.
    pub(super) fn of(name: &str) -> Option<Self> {
        match name {
            "logistic" => Some(Self::logistic),
            "ln_logistic" => Some(Self::ln_logistic),
            "ln_gamma" => Some(Self::ln_gamma),
            _ => FREE.contains(&name).then(|| Method::of(name)).flatten().map(Self::method),
        }
    }

    /// Whether it takes whole numbers, too: `exp(2)`.
    pub(super) fn takes_whole(self) -> bool {
        matches!(self, Self::method(_))
    }

    /// Not inlined, so that it is compiled once for each number type.
    #[inline(never)]
    pub(super) fn at<D: Real>(self, x: D) -> D {
        match self {
            Self::neg => -x,
            Self::method(method) => method.at(x),
            Self::logistic => logistic(x),
            Self::ln_logistic => ln_logistic(x),
            Self::ln_gamma => ln_gamma(x),
        }
    }
}

/// At most so many arguments has a surrogate.
pub(super) const MOST: usize = 5;

macro_rules! surrogates {
    ($($Name:ident = $path:literal, $function:path, [$($x:ident),*];)*) => {
        /// A surrogate that ships.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub(super) enum Surrogate { $($Name),* }

        impl Surrogate {
            /// That which is called so, and how many arguments it takes.
            pub(super) fn of(path: &str) -> Option<(Self, usize)> {
                match path {
                    $($path => Some((Self::$Name, [$(stringify!($x)),*].len())),)*
                    _ => None,
                }
            }

            /// Its value; not inlined, so that it is compiled once for each number type.
            #[inline(never)]
            pub(super) fn at<T: Real>(self, of: [Num<T>; MOST]) -> Num<T> {
                match self {
                    $(Self::$Name => {
                        let [$($x,)* ..] = of;
                        $function($($x),*)
                    })*
                }
            }
        }
    };
}
surrogates! {
    ErpS2 = "surrogate::erp_s2", surrogate::erp_s2, [a, b];
    ErpS3 = "surrogate::erp_s3", surrogate::erp_s3, [a, b];
    EmulatedErpS2 = "surrogate::emulated::erp_s2", emulated::erp_s2, [a, b];
    EmulatedErpS2Sd = "surrogate::emulated::erp_s2_sd", emulated::erp_s2_sd, [a, b];
    EmulatedErpS3 = "surrogate::emulated::erp_s3", emulated::erp_s3, [a, b];
    EmulatedErpS3Sd = "surrogate::emulated::erp_s3_sd", emulated::erp_s3_sd, [a, b];
    FiveErpS2 = "surrogate::five::erp_s2", five::erp_s2, [a, b, c, d, e];
    FiveErpS2Sd = "surrogate::five::erp_s2_sd", five::erp_s2_sd, [a, b, c, d, e];
    FiveErpS3 = "surrogate::five::erp_s3", five::erp_s3, [a, b, c, d, e];
    FiveErpS3Sd = "surrogate::five::erp_s3_sd", five::erp_s3_sd, [a, b, c, d, e];
    FiveUnrecovered = "surrogate::five::unrecovered", five::unrecovered, [a, b, c];
    FiveApd90 = "surrogate::five::apd90", five::apd90, [a, b, c, d, e];
    FiveApd90Sd = "surrogate::five::apd90_sd", five::apd90_sd, [a, b, c, d, e];
    FiveCv = "surrogate::five::cv", five::cv, [a, b, c, d, e];
    FiveCvSd = "surrogate::five::cv_sd", five::cv_sd, [a, b, c, d, e];
}
