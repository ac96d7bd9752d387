//! The ranges that were measured, each with its source. Radii and bends: surfaces and centre lines of five people (GCA-Models: CT
//! `Edin00090`, `Edin00060`, `Edin00020`, Visible Human male and female), project reference on the gut, section B; their
//! rounding is allowed for (half a unit of the last digit stated), so that the people measured lie inside.

use super::Quantity;

/// What was measured of one quantity of one part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredRange {
    /// Name of the part.
    pub part: &'static str,
    /// The quantity.
    pub quantity: Quantity,
    /// Smallest and largest value, SI.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Who measured it.
    pub source: &'static str,
}

const PEOPLE: &str = "GCA-Models, 3 to 5 people";
/// The reference rounds to 20 to 24 mm and 48 to 62 /m; by the method here `Edin00090` has 19.0 mm and 63.4 /m.
const BENDS: &str = "GCA-Models, 3 small bowels, smoothed 5 mm";
const COLON_BENDS: &str = "GCA-Models, 5 colons, smoothed 5 mm; 14 turns in a redundant one";

const fn range(
    part: &'static str,
    quantity: Quantity,
    low: f64,
    high: f64,
    source: &'static str,
) -> MeasuredRange {
    MeasuredRange { part, quantity, low, high, source }
}

/// All ranges there are.
pub const MEASURED: [MeasuredRange; 30] = {
    use Quantity::{
        BendRadiusMedian, BendRadiusP5, Length, LengthPerTurn, MeanCurvature, RadiusMedian, SharpTurns,
    };
    [
        // Mean 0.229 m; the standard error of 0.002 m over 252 people makes a deviation of 0.032 m; two to either side.
        range("oesophagus", Length, 0.165, 0.293, "manometry, n = 252: 22.9 ± 0.2 (SEM) cm, ± 2 sd"),
        range("oesophagus", RadiusMedian, 0.0056, 0.010, "GCA-Models, 1 person, 7.5 mm - 25 %; ~2 cm wide"),
        range("stomach", Length, 0.135, 0.225, "GCA-Models, 1 person, 0.18 m ± 25 %"),
        range("stomach", RadiusMedian, 0.0135, 0.0225, "GCA-Models, 1 person, 18 mm ± 25 % (empty)"),
        range("duodenum", Length, 0.14, 0.25, "GCA-Models, 3 people; Steinbrück: ~25 cm"),
        range(
            "duodenum",
            RadiusMedian,
            0.008,
            0.0137,
            "GCA-Models, 3 people (8 to 13 mm; 13.6 in the tract file)",
        ),
        range("jejunum", Length, 0.57, 1.38, "GCA-Models, 3 people; 2/5 of 2.83 to 3.45 m in the living"),
        range("jejunum", RadiusMedian, 0.007, 0.00845, "GCA-Models, 3 people"),
        range("ileum", Length, 0.97, 2.07, "GCA-Models, 3 people; 3/5 of 2.83 to 3.45 m in the living"),
        range(
            "ileum",
            RadiusMedian,
            0.0066,
            0.0098,
            "GCA-Models, 3 people; 9.5 mm distally in the literature",
        ),
        range(
            "small bowel",
            Length,
            1.84,
            3.70,
            "GCA-Models, 3 people; 2.83 to 3.45 m from Treitz, + duodenum",
        ),
        range("small bowel", RadiusMedian, 0.007, 0.0083, "GCA-Models, 3 people"),
        range("small bowel", BendRadiusMedian, 0.0188, 0.024, BENDS),
        range("small bowel", BendRadiusP5, 0.0065, 0.009, BENDS),
        range("small bowel", MeanCurvature, 48.0, 64.0, BENDS),
        range("small bowel", LengthPerTurn, 0.075, 0.095, BENDS),
        range("caecum", Length, 0.04, 0.08, PEOPLE),
        range("caecum", RadiusMedian, 0.0165, 0.032, PEOPLE),
        range("ascending", Length, 0.11, 0.27, PEOPLE),
        range("ascending", RadiusMedian, 0.017, 0.023, PEOPLE),
        range("transverse", Length, 0.27, 0.65, PEOPLE),
        range("transverse", RadiusMedian, 0.012, 0.023, PEOPLE),
        range("descending", Length, 0.22, 0.59, PEOPLE),
        range("descending", RadiusMedian, 0.0075, 0.020, PEOPLE),
        range("sigmoid and rectum", Length, 0.26, 0.75, PEOPLE),
        range("sigmoid and rectum", RadiusMedian, 0.009, 0.017, PEOPLE),
        range(
            "colon",
            Length,
            0.97,
            1.959,
            "Utano 2021, CT colonography, n = 295: 1.097 to 1.959 m; GCA-Models 0.97 m",
        ),
        range("colon", RadiusMedian, 0.008, 0.023, PEOPLE),
        range("colon", BendRadiusMedian, 0.026, 0.045, COLON_BENDS),
        range("colon", SharpTurns, 3.0, 7.0, COLON_BENDS),
    ]
};
