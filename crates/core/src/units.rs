//! The unit that a name ends in: of a key, a column, a channel.
//!
//! One table for everybody: what `laws::check_units` accepts is what `scenarios show --resolved` prints. The longest
//! suffix that fits counts (`speed_m_s` is m/s, not s). `_a_b` reads "a per b" for kinematic and field units (`_m_s`, `_a_m`,
//! `_kg_m3`), as written in column names long before this program; products are told by their own entries (`_pa_s`, `_n_s_m`).

/// Suffixes and the units they stand for.
const UNITS: [(&str, &str); 60] = [
    ("_m", "m"),
    ("_mm", "mm"),
    ("_m2", "m^2"),
    ("_m3", "m^3"),
    ("_per_m", "1/m"),
    ("_per_mm", "1/mm"),
    ("_s", "s"),
    ("_ms", "ms"),
    ("_us", "us"),
    ("_ns", "ns"),
    ("_hz", "Hz"),
    ("_per_s", "1/s"),
    ("_per_min", "1/min"),
    ("_per_hour", "1/h"),
    ("_per_day", "1/day"),
    ("_m_s", "m/s"),
    ("_mm_s", "mm/s"),
    ("_m_s2", "m/s^2"),
    ("_mps2", "m/s^2"),
    ("_m_s_per_sqrt_s", "m/s per sqrt(s)"),
    ("_m_per_sqrt_s", "m per sqrt(s)"),
    ("_rad", "rad"),
    ("_deg", "degrees"),
    ("_rad_s", "rad/s"),
    ("_radps", "rad/s"),
    ("_deg_s", "degrees/s"),
    ("_rad_s_per_sqrt_s", "rad/s per sqrt(s)"),
    ("_kg", "kg"),
    ("_g", "g"),
    ("_kg_m2", "kg m^2"),
    ("_kg_m3", "kg/m^3"),
    ("_n", "N"),
    ("_newton", "N"),
    ("_nm", "N m"),
    ("_n_m", "N/m"),
    ("_newton_per_m", "N/m"),
    ("_n_s_m", "N s/m"),
    ("_newton_s_per_m", "N s/m"),
    ("_pa", "Pa"),
    ("_pa_s", "Pa s"),
    ("_j", "J"),
    ("_w", "W"),
    ("_kev", "keV"),
    ("_v", "V"),
    ("_tesla", "T"),
    ("_T", "T"),
    ("_ut", "uT"),
    ("_t_m3", "T m^3"),
    ("_a_m", "A/m"),
    ("_a_m2", "A m^2"),
    ("_dB", "dB"),
    ("_db", "dB"),
    ("_dBm", "dBm"),
    ("_dbm", "dBm"),
    ("_bq", "Bq"),
    ("_px", "pixels"),
    ("_index", "index"),
    ("_count", "count"),
    ("_unit", "unit vector"),
    ("_image", "image"),
];

/// The unit that a name ends in; `None` where it names none.
pub fn unit_of(name: &str) -> Option<&'static str> {
    let fits = UNITS.iter().filter(|(suffix, _)| name.ends_with(suffix));
    fits.max_by_key(|(suffix, _)| suffix.len()).map(|(_, unit)| *unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_units_of_names() {
        for (name, unit) in [
            ("radius_mm", "mm"),
            ("speed_m_s", "m/s"),
            ("gravity_torso_m_s2", "m/s^2"),
            ("velocity_random_walk_m_s_per_sqrt_s", "m/s per sqrt(s)"),
            ("rate_random_walk_rad_s_per_sqrt_s", "rad/s per sqrt(s)"),
            ("damping_newton_s_per_m", "N s/m"),
            ("stiffness_newton_per_m", "N/m"),
            ("coulomb_newton", "N"),
            ("viscous_n_s_m", "N s/m"),
            ("fluid_viscosity_pa_s", "Pa s"),
            ("fluid_density_kg_m3", "kg/m^3"),
            ("axial_kg_m2", "kg m^2"),
            ("mass_rate_per_day", "1/day"),
            ("envelope_rate_per_s", "1/s"),
            ("curvature_per_m", "1/m"),
            ("moment_a_m2", "A m^2"),
            ("magnetization_unit_a_m", "A/m"),
            ("strength_t_m3", "T m^3"),
            ("mass_g", "g"),
            ("s1x_T", "T"),
        ] {
            assert_eq!(unit_of(name), Some(unit), "{name}");
        }
        for name in ["name", "sensors", "friction", "amplitude", "m", "length_scale", "d_ds", "rows"] {
            assert_eq!(unit_of(name), None, "{name}");
        }
    }

    #[test]
    fn law_no_suffix_stands_twice() {
        for (i, (suffix, _)) in UNITS.iter().enumerate() {
            assert!(suffix.starts_with('_'), "{suffix}");
            assert!(UNITS[..i].iter().all(|(other, _)| other != suffix), "{suffix}");
        }
    }
}
