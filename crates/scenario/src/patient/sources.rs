//! Where the defaults of `[patient]` and of `[[patient.event]]` come from.

/// Key of [`super::PatientConfig`] and source of its default.
pub const PATIENT_SOURCES: [(&str, &str); 6] = [
    ("posture", "chosen: on the back, as in a scanner"),
    (
        "breathing_amplitude_mm",
        "Kim et al. 2007: 12.8 and 13.0 mm of head and tail of the pancreas, supine; organs of the abdomen 11.7 to 17.3 mm (4D CT, 9 people)",
    ),
    ("breathing_period_s", "believed: 12 breaths a minute at rest"),
    (
        "surface_amplitude_mm",
        "believed: quiet breathing lifts the belly of a lying patient by 5 to 10 mm; a belt holds part of it back",
    ),
    ("organ_shift_mm", "believed: of the order of a breath; bowel hangs loose from its root"),
    ("organ_shift_s", "believed: bowel and fluid come to rest within some breaths"),
];

/// Key of a [`super::PatientEvent`] and source of its default.
pub const PATIENT_EVENT_SOURCES: [(&str, &str); 6] = [
    ("duration_s", "chosen: a turn in bed takes 4 s, a cough 0.3 s, a ride on the table 10 s"),
    ("acceleration_m_s2", "believed: half of gravity; displaces the gut by 19 mm within the 0.3 s"),
    ("direction", "chosen: cranial, as the diaphragm gives way"),
    ("step_frequency_hz", "believed: 110 steps a minute at a comfortable speed"),
    ("amplitude_mm", "believed: the trunk rises and falls by 40 to 50 mm from lowest to highest"),
    ("speed_m_s", "chosen: on the spot, or on a treadmill"),
];
