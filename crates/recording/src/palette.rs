//! Colours that people with any colour vision can tell apart (Okabe and Ito 2008, "Color universal design").

use lumenav_figures::viridis;

/// Grey of the truth, as `0xRRGGBBAA`: legible on dark and on light ground.
pub(crate) const TRUTH: u32 = 0x9a9a9aff;
/// Ground of the 3-D scene and of plots: nearly black, so that pictures of view and plots belong together.
pub(crate) const GROUND: u32 = 0x0d1011ff;
/// Bands in plots.
pub(crate) const BAND: u32 = 0x6b6b6bff;

/// Speeds of the two ends of the colours of a path, m/s; between them equal ratios look equally far apart.
const SPEEDS_M_S: [f64; 2] = [1e-4, 1e-2];
/// What the colours of a path say, for a reader.
pub(crate) const SPEED_LEGEND: &str = "trail: violet 0.1 mm/s, green 1, yellow 10";

/// Track colours in the file's order: vermilion, sky blue, bluish green, orange, reddish purple, yellow, blue.
const TRACKS: [u32; 7] = [0xd55e00ff, 0x56b4e9ff, 0x009e73ff, 0xe69f00ff, 0xcc79a7ff, 0xf0e442ff, 0x0072b2ff];

/// The colour of the `index`-th track.
pub(crate) fn track(index: usize) -> u32 {
    TRACKS[index % TRACKS.len()]
}

/// The colour of a speed.
pub(crate) fn speed(speed_m_s: f64) -> u32 {
    let [low, high] = SPEEDS_M_S.map(f64::ln);
    let share = (speed_m_s.max(SPEEDS_M_S[0]).ln() - low) / (high - low);
    let [red, green, blue] = viridis(share);
    u32::from_be_bytes([red, green, blue, 0xff])
}

/// The same colour with another opacity, 0 to 255.
pub(crate) fn with_alpha(rgba: u32, alpha: u8) -> u32 {
    (rgba & 0xffff_ff00) | u32::from(alpha)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_speeds_run_from_violet_to_yellow() {
        assert_eq!(speed(0.0), 0x440154ff);
        assert_eq!(speed(1e-4), 0x440154ff);
        assert_eq!(speed(1e-2), 0xfde725ff);
        assert_eq!(speed(1.0), 0xfde725ff);
        assert_eq!(speed(1e-3) >> 8, u32::from_be_bytes([0, 0x21, 0x90, 0x8d]));
    }

    #[test]
    fn published_track_colours_are_distinct() {
        for i in 0..TRACKS.len() {
            for j in 0..i {
                assert_ne!(track(i), track(j));
            }
        }
        assert_eq!(with_alpha(track(0), 0x40), 0xd55e0040);
    }
}
