//! Where the defaults of `[engine]` come from.

/// Key of [`super::EngineConfig`] and source of its default.
pub const ENGINE_SOURCES: [(&str, &str); 17] = [
    ("step_rate_hz", "tuned: end points of a wave agree with those at 1,000 Hz within 1 %"),
    ("settle_s", "chosen: several times what most starts take (1 to 3 s)"),
    ("sleep", "chosen: what it leaves out is the creep of the regularised friction"),
    ("gravity_torso_m_s2", "standard gravity, rounded; a patient lying on the back"),
    (
        "dry_segments",
        "chosen: the sip runs ahead in the oesophagus, a bowel is prepared with litres of fluid",
    ),
    ("fluid_density_kg_m3", "water"),
    ("fluid_viscosity_pa_s", "water at 20 degrees Celsius"),
    ("drag_coefficient", "Hoerner 1965: short cylinder across, 0.6 to 1.2 over the Reynolds numbers met"),
    ("coulomb_newton", "believed: a capsule of 11 mm is dragged with 20 to 100 mN"),
    (
        "regularisation_m_s",
        "tuned: to no transport without waves (at 2e-4 a capsule creeps 7 mm a minute down a slope)",
    ),
    (
        "viscous_newton_s_per_m",
        "believed: the 91 mN of traction of a contraction (Ahluwalia 1994) at 1 to 5 mm/s",
    ),
    ("contraction_stiffening", "tuned: to a mass movement of the colon taking the capsule along"),
    ("cap_stiffness_newton_per_m", "believed: the capsule's weight gives 0.05 mm"),
    ("cap_damping_newton_s_per_m", "believed: that of a ring of the wall"),
    ("stalled_after_s", "chosen: ten minutes, longer than the rests between small-bowel contractions"),
    (
        "retained_after_s",
        "chosen: of a healthy colon, too, a capsule may rest so long; clinically retention is two weeks and more (Cave et al. 2005)",
    ),
    ("stalled_distance_m", "chosen: less than half a capsule's length is no way"),
];
