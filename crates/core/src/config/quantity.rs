//! Numbers that are checked while they are parsed, so that the error names the line.

use serde::{Deserialize, Deserializer, Serialize, de};

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $allowed:literal, |$v:ident| $check:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let $v = f64::deserialize(deserializer)?;
                if $check {
                    Ok(Self($v))
                } else {
                    Err(de::Error::custom(format!(concat!("{} is not allowed here; ", $allowed), $v)))
                }
            }
        }
    };
}

quantity!(
    /// Any number that is not NaN or infinite.
    Finite, "it must be a finite number", |v| v.is_finite()
);
quantity!(
    /// A finite number above zero.
    Positive, "it must be a finite number above 0", |v| v.is_finite() && v > 0.0
);
quantity!(
    /// A finite number, zero or above.
    NonNegative, "it must be a finite number, 0 or above", |v| v.is_finite() && v >= 0.0
);
quantity!(
    /// A number from 0 to 1.
    Fraction, "it must be from 0 to 1", |v| (0.0..=1.0).contains(&v)
);
