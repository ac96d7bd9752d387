//! What a figure is made of.

/// How an axis counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Equal steps.
    Linear,
    /// Equal ratios.
    Logarithmic,
}

/// An axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What it shows, with its unit in brackets.
    pub label: String,
    /// How it counts.
    pub scale: Scale,
    /// What it shows at least; it grows so that every point is seen.
    pub at_least: Option<[f64; 2]>,
    /// Names of 0, 1, 2, … on an axis of categories; empty else.
    pub categories: Vec<String>,
}

impl Axis {
    /// Equal steps.
    pub fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), scale: Scale::Linear, at_least: None, categories: Vec::new() }
    }

    /// Equal ratios.
    pub fn logarithmic(label: &str) -> Self {
        Self { scale: Scale::Logarithmic, ..Self::linear(label) }
    }

    /// One place per name: 0, 1, 2, …
    pub fn categories<S: Into<String>>(label: &str, names: impl IntoIterator<Item = S>) -> Self {
        Self { categories: names.into_iter().map(Into::into).collect(), ..Self::linear(label) }
    }

    /// Shows at least this much.
    pub fn at_least(mut self, low: f64, high: f64) -> Self {
        self.at_least = Some([low, high]);
        self
    }
}

/// How a curve is dashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dash {
    /// No line, symbols only.
    None,
    /// Unbroken.
    Solid,
    /// Dashes.
    Dashed,
    /// Dots.
    Dotted,
}

/// The symbol at a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symbol {
    /// None.
    None,
    /// A ring.
    Ring,
    /// A filled disc.
    Disc,
    /// A filled square.
    Square,
    /// A filled triangle.
    Triangle,
    /// A filled diamond.
    Diamond,
    /// An x.
    Cross,
}

/// How a series looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// How a curve is dashed.
    pub dash: Dash,
    /// The symbol at a point.
    pub symbol: Symbol,
}

/// What is drawn through the points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Straight from point to point.
    Curve,
    /// Level until the next point, as a cumulative distribution.
    Steps,
    /// A bar from zero (or from the axis' end where it is logarithmic); the bars of one category stand side by side.
    Bars,
}

/// One point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where.
    pub x: f64,
    /// How much.
    pub y: f64,
    /// Ends of its error bar.
    pub bar: Option<[f64; 2]>,
}

/// Points that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name in the legend; series of one name in several panels share the entry.
    pub name: String,
    /// How it looks.
    pub style: Style,
    /// What is drawn through the points.
    pub kind: Kind,
    /// The points, in the order in which they are joined.
    pub points: Vec<Point>,
}

/// Colours that people with colour-blindness tell apart (Okabe and Ito 2008, "Color universal design"), black left out: it is for
/// published values.
pub(crate) const COLOURS: [[u8; 3]; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [230, 159, 0],
    [120, 94, 10],
];
const SYMBOLS: [Symbol; 5] = [Symbol::Disc, Symbol::Square, Symbol::Triangle, Symbol::Diamond, Symbol::Cross];
const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];

impl Series {
    /// What a publication states: black, rings, dashed.
    pub fn published(name: &str) -> Self {
        let style = Style { colour: [0; 3], dash: Dash::Dashed, symbol: Symbol::Ring };
        Self { name: name.to_owned(), style, kind: Kind::Curve, points: Vec::new() }
    }

    /// The `index`-th of our own: a colour and a symbol of its own.
    pub fn ours(index: usize, name: &str) -> Self {
        let style = Style {
            colour: COLOURS[index % COLOURS.len()],
            dash: Dash::Solid,
            symbol: SYMBOLS[index % SYMBOLS.len()],
        };
        Self { name: name.to_owned(), style, kind: Kind::Curve, points: Vec::new() }
    }

    /// Lines without symbols: for hundreds of points. The dash tells curves apart where colours do not.
    pub fn line(mut self, index: usize) -> Self {
        self.style.symbol = Symbol::None;
        self.style.dash = DASHES[index % DASHES.len()];
        self
    }

    /// Symbols without lines: for measurements between which nothing is known.
    pub fn symbols(mut self) -> Self {
        self.style.dash = Dash::None;
        self
    }

    /// Bars.
    pub fn bars(mut self) -> Self {
        self.kind = Kind::Bars;
        self
    }

    /// Points `(x, y)`.
    pub fn points(mut self, points: &[(f64, f64)]) -> Self {
        self.points = points.iter().map(|(x, y)| Point { x: *x, y: *y, bar: None }).collect();
        self
    }

    /// Points `(x, y, half)` with an error bar from `y - half` to `y + half`.
    pub fn points_with_bars(mut self, points: &[(f64, f64, f64)]) -> Self {
        let point = |(x, y, half): &(f64, f64, f64)| Point { x: *x, y: *y, bar: Some([y - half, y + half]) };
        self.points = points.iter().map(point).collect();
        self
    }

    /// The empirical distribution of values: how large a share is at most x. Values that are not finite are counted in the total and
    /// never reached, so the curve ends below 1.
    pub fn distribution(mut self, values: &[f64]) -> Self {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let share = |k: usize| (k + 1) as f64 / values.len() as f64;
        self.points =
            sorted.iter().enumerate().map(|(k, x)| Point { x: *x, y: share(k), bar: None }).collect();
        self.kind = Kind::Steps;
        self.style.symbol = Symbol::None;
        self
    }
}

/// Two axes and what they hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Its title; empty for none.
    pub title: String,
    /// The axis to the right.
    pub x: Axis,
    /// The axis upwards.
    pub y: Axis,
    /// What is drawn, the first one lowest.
    pub series: Vec<Series>,
}

impl Panel {
    /// An empty panel.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { title: String::new(), x, y, series: Vec::new() }
    }

    /// With a title.
    pub fn titled(mut self, title: &str) -> Self {
        title.clone_into(&mut self.title);
        self
    }

    /// With one series more.
    pub fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }
}

/// Panels in a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// The panels, row by row.
    pub panels: Vec<Panel>,
    /// Panels per row.
    pub columns: usize,
    /// Width and height of a panel, CSS pixels (96 per inch).
    pub panel_size_px: [u32; 2],
}

impl Figure {
    /// One panel, as wide as a column of a paper (90 mm).
    pub fn of(panel: Panel) -> Self {
        Self::grid(vec![panel], 1)
    }

    /// Several panels, `columns` per row.
    pub fn grid(panels: Vec<Panel>, columns: usize) -> Self {
        Self { panels, columns: columns.max(1), panel_size_px: [340, 250] }
    }

    /// Panels of another size.
    pub fn panel_size(mut self, width_px: u32, height_px: u32) -> Self {
        self.panel_size_px = [width_px, height_px];
        self
    }

    /// The figure as SVG.
    ///
    /// # Errors
    /// A panel without a point that can be drawn.
    pub fn to_svg(&self) -> Result<String, crate::FigureError> {
        crate::draw::svg(self)
    }
}
