//! The surfaces of real people, and what a user would name on them. Also read by the acceptance (`tests/validate/gut.rs`).

/// A surface of a person.
#[derive(Clone, Copy)]
pub struct Imported {
    /// The person: `<person>_centerline.csv` has the line given.
    pub person: &'static str,
    /// `<person>_<organ>.stl`.
    pub organ: &'static str,
    /// The segments of the line given that it holds.
    pub segments: &'static [&'static str],
    /// Waypoints that help, mm; empty where none is needed.
    pub waypoints_mm: &'static [[f64; 3]],
}

/// The four surfaces that there are.
pub const PEOPLE: [Imported; 4] = [
    Imported {
        person: "EdinGCA_3D_00090",
        organ: "small_intestine",
        segments: &["esophagus_part", "stomach", "duodenum", "jejunum", "ileum", "terminal_ileum"],
        waypoints_mm: &[],
    },
    // The ileocaecal valve.
    Imported {
        person: "EdinGCA_3D_00090",
        organ: "large_intestine",
        segments: &["cecum", "cecum_colon", "ascending", "transverse", "descending", "sigmoid", "rectum"],
        waypoints_mm: &[[154.0, 164.0, 184.0]],
    },
    Imported {
        person: "HuBMAPVHM_3D_00070",
        organ: "small_intestine",
        segments: &["duodenum", "jejunum", "ileum", "terminal_ileum"],
        waypoints_mm: &[],
    },
    // The mouth of the appendix, the caecum, the valve, the hepatic flexure, the lowest place of the transverse colon, the splenic flexure,
    // where the descending colon ends, the rectum, the anus.
    Imported {
        person: "HuBMAPVHM_3D_00070",
        organ: "large_intestine",
        segments: &["cecum", "ascending", "transverse", "descending", "sigmoid_rectum"],
        waypoints_mm: &[
            [-59.0, -35.0, 125.0],
            [-60.0, -60.0, 137.0],
            [-85.0, -60.0, 190.0],
            [-63.0, -60.0, 320.0],
            [-60.0, -90.0, 258.0],
            [97.0, -32.0, 376.0],
            [60.0, -62.0, 87.0],
            [0.0, 60.0, 65.0],
            [2.0, 83.0, -23.0],
        ],
    },
];
