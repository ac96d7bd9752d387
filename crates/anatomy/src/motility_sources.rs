//! Where the defaults of `[motility]` come from.
//!
//! "believed" is what no source was found for, "tuned" what was fitted to the target beside it, "chosen" what is a matter of taste.

const HUMPHRIES: &str = "Humphries and Castell 1977";
const KERLIN: &str = "Kerlin and Phillips 1982";
const COOK: &str = "propulsive sequences of 11 healthy subjects, Am J Physiol Gastrointest Liver Physiol 2000, 278:G329, doi:10.1152/ajpgi.2000.278.2.G329";
const PROPULSIVE: &str = "tuned to a colonic transit of 16 to 29 h in the median; 6.9 to 10 a day are of high amplitude (Rao et al. 2001, Am J Physiol 280:G629), \
but those that propel have 50 mmHg in the mean and are a third of all (doi:10.1152/ajpgi.2000.278.2.G329)";
const PACED: &str = "believed: slow waves pace it";
const BELIEVED: &str = "believed";
const SUPINE: &str =
    "tuned, rate, growth, amplitude and spread together: to 23.6 s supine (World J Gastroenterol 14:5707)";
const AUGMENTED: &str = "tuned, with rate, amplitude and spread, to 23.6 s supine; that the oesophagus answers to what distends it with stronger contraction and \
secondary peristalsis: Gastroenterology 1977, 72:1292 (pmid:858473)";
const TRANSIT: &str =
    "tuned to a small-bowel transit of 198 min (O'Grady et al., 71 people), with a look at the traction";
const BOTH_WAYS: &str = "tuned, with runs and amplitude, to a small-bowel transit of 198 min (O'Grady et al., 71 people); in the duodenum beyond its first \
centimetres 10 to 29 % of the waves run back (postprandial peristalsis)";
const GASTRIC: &str = "tuned: to a capsule that reaches the pylorus";
const MASS_TUNED: &str = "tuned, with width or amplitude, to a sequence that moves content by 0.25 m";
const ORIGIN: &str = "tuned to a colonic transit of 16 to 29 h in the median; that they arise more often proximally: doi:10.1152/ajpgi.2000.278.2.G329";

/// Key of [`crate::motility_config::MotilityConfig`] (dotted for its tables) and source of its default.
pub const MOTILITY_SOURCES: [(&str, &str); 96] = [
    ("amplitude_scale", "chosen: the amplitudes as they stand"),
    ("spontaneous", "chosen: a living bowel"),
    ("taenia_relief", "chosen: the published law of the radius has no angle"),
    ("wave.start_m", "chosen: the tract's or segment's oral end"),
    ("wave.speed_m_s", COOK),
    ("wave.run_m", COOK),
    ("wave.width_m", MASS_TUNED),
    ("wave.amplitude", MASS_TUNED),
    ("wave.flattens_ahead_m", "believed, after Guyton and Hall, Textbook of Medical Physiology"),
    ("mmc.period_s", KERLIN),
    (
        "mmc.period_spread",
        "Kerlin and Phillips 1982: intervals of 15 to 195 min; their even distribution is believed",
    ),
    ("mmc.start_phase", "drawn from the seed"),
    ("mmc.fractions", "believed: I 50 to 60 %, II 30 to 40 %, III 5 to 10 min"),
    ("mmc.rate_factor", "Ahluwalia 1994: none in phase I, 2.5 per minute in phase II"),
    ("oesophagus.swallow_time_s", "chosen: the exam begins with the swallow"),
    ("oesophagus.speed_m_s", HUMPHRIES),
    ("oesophagus.further_rate_hz", SUPINE),
    ("oesophagus.further_growth_per_s", AUGMENTED),
    ("oesophagus.amplitude", SUPINE),
    ("oesophagus.amplitude_spread", SUPINE),
    ("oesophagus.width_m", BELIEVED),
    ("stomach.rate_hz", "3.1 per minute (2.6 to 3.8), 125 people followed by a magnetic pill (3D-Transit)"),
    ("stomach.speed_m_s", "2.4 mm/s, 0 to 14 (Boiron et al.)"),
    ("stomach.amplitude", GASTRIC),
    ("stomach.amplitude_spread", "chosen: none"),
    ("stomach.width_m", BELIEVED),
    ("stomach.run_m", BELIEVED),
    ("stomach.aboral_fraction", BELIEVED),
    ("stomach.refractory_fraction", PACED),
    ("pylorus.closure", BELIEVED),
    ("pylorus.width_m", BELIEVED),
    (
        "pylorus.opening_fraction",
        "tuned: to gastric emptying of a fasting capsule, median 22 min, quartiles 10 and 48",
    ),
    ("pylorus.open_s", BELIEVED),
    ("pylorus.ahead_m", "believed: a wave carries a capsule in front of it"),
    ("duodenum.rate_hz", KERLIN),
    ("duodenum.speed_m_s", TRANSIT),
    ("duodenum.amplitude", TRANSIT),
    ("duodenum.amplitude_spread", TRANSIT),
    ("duodenum.width_m", BELIEVED),
    ("duodenum.run_m", BELIEVED),
    ("duodenum.aboral_fraction", BELIEVED),
    ("duodenum.refractory_fraction", PACED),
    ("jejunum.rate_hz", KERLIN),
    ("jejunum.speed_m_s", TRANSIT),
    ("jejunum.amplitude", TRANSIT),
    ("jejunum.amplitude_spread", TRANSIT),
    ("jejunum.width_m", BELIEVED),
    ("jejunum.run_m", TRANSIT),
    ("jejunum.aboral_fraction", BOTH_WAYS),
    ("jejunum.refractory_fraction", PACED),
    ("ileum.rate_hz", KERLIN),
    ("ileum.speed_m_s", TRANSIT),
    ("ileum.amplitude", TRANSIT),
    ("ileum.amplitude_spread", TRANSIT),
    ("ileum.width_m", BELIEVED),
    ("ileum.run_m", TRANSIT),
    ("ileum.aboral_fraction", BOTH_WAYS),
    ("ileum.refractory_fraction", PACED),
    ("terminal_ileum.rate_hz", KERLIN),
    ("terminal_ileum.speed_m_s", TRANSIT),
    ("terminal_ileum.amplitude", TRANSIT),
    ("terminal_ileum.amplitude_spread", TRANSIT),
    ("terminal_ileum.width_m", BELIEVED),
    ("terminal_ileum.run_m", BELIEVED),
    ("terminal_ileum.aboral_fraction", BELIEVED),
    ("terminal_ileum.refractory_fraction", PACED),
    (
        "colon.burst_fraction",
        "believed, after scant contractions with infrequent bursts in 263 h of nine people, doi:10.1152/ajpgi.1989.257.4.G601",
    ),
    ("colon.burst_s", BELIEVED),
    ("colon.haustral_rate_hz", "bursts of 3 per minute, Rao et al. 2001, Am J Physiol 280:G629"),
    ("colon.haustral_speed_m_s", BELIEVED),
    ("colon.haustral_amplitude", BELIEVED),
    ("colon.haustral_width_m", "believed: a third of the distance between haustra"),
    ("colon.haustral_run_m", "believed: up to one haustrum"),
    ("colon.haustral_aboral_fraction", BELIEVED),
    ("colon.mass_rate_per_day", PROPULSIVE),
    ("colon.mass_speed_m_s", COOK),
    ("colon.mass_run_m", COOK),
    ("colon.mass_amplitude", MASS_TUNED),
    ("colon.mass_width_m", MASS_TUNED),
    ("colon.mass_flattens_ahead_m", "believed, after Guyton and Hall, Textbook of Medical Physiology"),
    ("colon.mass_caecal_fraction", ORIGIN),
    ("colon.defecation_rate_per_day", "once a day, the commonest habit (Heaton et al. 1992, Gut 33:818)"),
    (
        "colon.retrograde_rectosigmoid_rate_hz",
        "3 per minute in the rectosigmoid, Rao et al. 2001, Am J Physiol 280:G629",
    ),
    ("colon.retrograde_speed_m_s", BELIEVED),
    ("colon.retrograde_amplitude", BELIEVED),
    ("colon.retrograde_run_m", BELIEVED),
    ("wave.start_time_s", "has no default"),
    ("wave.duration_s", "follows from run and speed"),
    ("meal.start_s", "chosen: from the beginning"),
    (
        "meal.duration_s",
        "3.6 h: a motility pill leaves the stomach after its meal, in a survey (J Clin Med 2023, 12:5272)",
    ),
    ("meal.rate_factor", "believed: as irregular as phase II"),
    ("meal.amplitude_factor", "tuned: to 58 mN of traction in the fed jejunum (Ahluwalia 1994)"),
    ("fault.kind", "has no default"),
    ("fault.start_s", "chosen: from the beginning"),
    ("fault.end_s", "chosen: for good"),
    ("fault.remaining", "chosen: a paralysis"),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motility_config::MotilityConfig;
    use lumenav_core::Node;
    use std::path::Path;

    #[test]
    fn law_every_default_has_a_source_and_every_source_a_key() {
        let text = "[[motility.wave]]\nstart_time_s = 1\nduration_s = 2\n[[motility.fault]]\nkind = \"ileus\"\nend_s = 9\n[[motility.meal]]\n[motility.mmc]\nstart_phase = 0.5\n";
        let node = Node::parse_text(text, "s.toml", Path::new(""), &[]).unwrap();
        let _: MotilityConfig = node.child_or_empty("motility").parse_sourced(&MOTILITY_SOURCES).unwrap();
        let entry = &node.log().entries()[0];
        let rows = entry.rows();
        for row in &rows {
            assert!(row.source.is_some() || row.set, "{} has no source", row.key);
        }
        // And by name, without the index of a wave.
        let keys: Vec<String> = rows.iter().map(|row| row.key.replace("[0]", "")).collect();
        for (key, source) in MOTILITY_SOURCES {
            assert!(!source.is_empty());
            assert!(keys.iter().any(|k| k == key) || key == "wave.run_m", "no key {key}");
        }
        assert!(rows.len() >= 65, "{}", rows.len());
    }
}
