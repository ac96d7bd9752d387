//! What than2015 states, as data.

/// A row of table 4.2: lines per 50 ms and their true share, helix of 36 s, three markers of 1.85 MBq.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateRow {
    /// Name of the phantom in `models/phantoms`.
    pub phantom: &'static str,
    /// Diameter of the water cylinder, cm.
    pub diameter_cm: f64,
    /// Full ring: lines per run.
    pub full_lines: f64,
    /// Full ring: share of true lines, per cent.
    pub full_true_percent: f64,
    /// Reduced scanner: lines per run.
    pub reduced_lines: f64,
    /// Reduced scanner: share of true lines, per cent.
    pub reduced_true_percent: f64,
}

const fn rate(phantom: &'static str, diameter_cm: f64, full: [f64; 2], reduced: [f64; 2]) -> RateRow {
    RateRow {
        phantom,
        diameter_cm,
        full_lines: full[0],
        full_true_percent: full[1],
        reduced_lines: reduced[0],
        reduced_true_percent: reduced[1],
    }
}

/// Table 4.2.
pub const RATES: [RateRow; 5] = [
    rate("water-20", 20.0, [2410.0, 73.1], [284.0, 81.9]),
    rate("water-25", 25.0, [1593.0, 65.4], [183.0, 75.9]),
    rate("water-30", 30.0, [1067.0, 58.8], [120.0, 70.2]),
    rate("water-35", 35.0, [722.0, 52.6], [80.0, 64.2]),
    rate("water-40", 40.0, [492.0, 47.3], [54.0, 59.2]),
];

/// A row of table 4.3: the reduced scanner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FewLinesRow {
    /// Lines per run, of table 4.2.
    pub lines: u32,
    /// Mean marker error, mm.
    pub mean_mm: f64,
    /// Standard deviation of the marker error, mm.
    pub sd_mm: f64,
    /// Runs of 720 with a marker more than 3 mm off.
    pub failures: u32,
}

/// Table 4.3, in the order of [`RATES`].
pub const FEW_LINES: [FewLinesRow; 5] = [
    FewLinesRow { lines: 284, mean_mm: 0.36, sd_mm: 0.18, failures: 0 },
    FewLinesRow { lines: 183, mean_mm: 0.40, sd_mm: 0.21, failures: 0 },
    FewLinesRow { lines: 120, mean_mm: 0.58, sd_mm: 0.55, failures: 7 },
    FewLinesRow { lines: 80, mean_mm: 0.74, sd_mm: 0.58, failures: 17 },
    FewLinesRow { lines: 54, mean_mm: 1.6, sd_mm: 3.2, failures: 118 },
];

/// Runs of a helix in tables 4.1 and 4.3.
pub const HELIX_RUNS: usize = 720;

/// Section 4.3.2 and table 4.1: full ring, cylinder of 20 cm, at most 210 lines of 2410.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticCylinder {
    /// Lines per run that the tracker takes.
    pub line_budget: usize,
    /// Mean marker error, mm.
    pub mean_mm: f64,
    /// Its standard deviation, mm.
    pub sd_mm: f64,
    /// Mean error of the orientation vector, degrees.
    pub orientation_deg: f64,
    /// Runs that failed.
    pub failures: u32,
    /// Error of the centroid alone with the budget, mm.
    pub centroid_mm: f64,
    /// Error of the centroid alone with all lines, mm.
    pub centroid_all_lines_mm: f64,
    /// Mean error per axis: across (x, y), mm.
    pub across_mm: f64,
    /// Mean error along z: from … to, mm.
    pub axial_mm: [f64; 2],
}

/// Section 4.3.2 and table 4.1.
pub const STATIC_CYLINDER: StaticCylinder = StaticCylinder {
    line_budget: 210,
    mean_mm: 0.37,
    sd_mm: 0.17,
    orientation_deg: 1.8,
    failures: 0,
    centroid_mm: 0.88,
    centroid_all_lines_mm: 0.38,
    across_mm: 0.25,
    axial_mm: [0.165, 0.21],
};

/// Section 4.4: voxel torso, colon, 1 mm/s, 5.5 MBq per marker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorsoRun {
    /// Lines per run of 50 ms.
    pub lines: f64,
    /// Share of true lines, per cent.
    pub true_percent: f64,
    /// Runs, all of them followed.
    pub runs: usize,
    /// Activity of each marker, MBq.
    pub activity_mbq: f64,
    /// Speed, mm/s.
    pub speed_mm_s: f64,
    /// Mean error of the three markers, chapter 4, mm.
    pub fcm_mm: [f64; 3],
    /// Mean error of the three markers, chapter 6, mm.
    pub rigid_mm: [f64; 3],
    /// Mean and standard deviation of the error of the orientation vector, degrees.
    pub orientation_deg: [f64; 2],
}

/// Section 4.4.
pub const TORSO: TorsoRun = TorsoRun {
    lines: 349.0,
    true_percent: 61.4,
    runs: 9420,
    activity_mbq: 5.5,
    speed_mm_s: 1.0,
    fcm_mm: [0.39, 0.48, 0.44],
    rigid_mm: [0.40, 0.41, 0.37],
    orientation_deg: [1.8, 1.2],
};

/// An experiment of chapter 5, with what chapter 6 made of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Experiment {
    /// Name of the scanner in `models/scanners`.
    pub scanner: &'static str,
    /// Length of a run, s.
    pub window_s: f64,
    /// Lines per run.
    pub lines: f64,
    /// Mean marker error, least and most of the markers, mm.
    pub mean_mm: [f64; 2],
    /// Mean error of the orientation vector, from … to, degrees.
    pub orientation_deg: [f64; 2],
    /// Runs.
    pub runs: usize,
    /// Runs that failed (section 5.5.1), `fcm`.
    pub fcm_failures: u32,
    /// Runs that failed, rigid (chapter 6).
    pub rigid_failures: u32,
}

/// Tables 5.2, 6.1 (TF 64).
pub const TF64: Experiment = Experiment {
    scanner: "tf64",
    window_s: 0.05,
    lines: 1732.0,
    mean_mm: [0.4, 0.5],
    orientation_deg: [2.2, 2.3],
    runs: 9600,
    fcm_failures: 29,
    rigid_failures: 18,
};

/// Tables 5.3, 6.2 (Allegro).
pub const ALLEGRO: Experiment = Experiment {
    scanner: "allegro",
    window_s: 0.1,
    lines: 2296.0,
    mean_mm: [0.6, 0.7],
    orientation_deg: [3.3, 3.5],
    runs: 4800,
    fcm_failures: 31,
    rigid_failures: 14,
};

/// The markers of the experiments: sides of the triangle as measured (base, apex to the one, apex to the other), mm.
pub const MEASURED_SIDES_MM: [f64; 3] = [10.57, 13.89, 13.46];
/// Their activities, MBq.
pub const MEASURED_ACTIVITIES_MBQ: [f64; 3] = [1.60, 1.48, 1.47];
/// Diameter of their cores, mm.
pub const MEASURED_CORE_MM: f64 = 0.25;

/// Length of a run in the simulations, s.
pub const WINDOW_S: f64 = 0.05;
/// Figure 4.11: the run at which the capsule jumps, and how far, mm.
pub const JUMP_RUN: usize = 300;
/// See [`JUMP_RUN`].
pub const JUMP_MM: f64 = 50.0;
/// Figure 4.12: slowest and fastest capsule, mm/s.
pub const SPEEDS_MM_S: [f64; 2] = [5.0, 40.0];
/// Section 3.6: equivalent dose of three markers of 1.85 MBq at 50 mm in 10 h, mSv.
pub const DOSE_BOUND_MSV: f64 = 8.04;
/// Section 3.6: gamma constant of Na-22, uSv/h per MBq at 1 m.
pub const GAMMA_NA22_USV_H_PER_MBQ: f64 = 0.362;
