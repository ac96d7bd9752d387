//! Where elements may stand: their spacing, places that are taken, and mirror planes.
//!
//! A mirror plane passes through the origin, at right angles to an axis. Elements then come in *orbits*: one and all its images, 2^m of them
//! for m planes; an orbit is chosen, moved or left out as a whole. Images stand at mirrored places with the same attitude.

use super::Question;
use crate::LayoutError;
use lumenav_core::LayoutElement;
use nalgebra::Vector3;

/// A ball in which no element may stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeepOut {
    /// Its centre, m.
    pub centre_m: Vector3<f64>,
    /// Its radius, m.
    pub radius_m: f64,
}

/// What a layout has to keep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sites {
    /// Least distance of two elements, m.
    pub spacing_m: f64,
    /// Where nothing may stand.
    pub keep_out: Vec<KeepOut>,
    /// Axes (0 to 2) whose sign may be turned.
    pub mirrored: Vec<usize>,
}

/// Elements whose places differ by less are at one place, m; and are turned alike where their turns do.
const SAME_PLACE_M: f64 = 1e-6;
const SAME_TURN_RAD: f64 = 1e-6;
/// A spacing may be missed by this share: rounding.
const SLACK: f64 = 1e-12;

/// An element's part of an orbit: its index and the signs that its place has over the first one's.
pub(super) type Image = (usize, [f64; 3]);

pub(super) fn place(element: &LayoutElement) -> Vector3<f64> {
    element.world_from_element.translation.vector
}

impl Sites {
    /// Elements in one orbit.
    pub fn orbit_len(&self) -> usize {
        1 << self.mirrored.len()
    }

    /// All combinations of signs; the first changes nothing.
    fn signs(&self) -> Vec<[f64; 3]> {
        let mut all = vec![[1.0; 3]];
        for axis in &self.mirrored {
            let mut images = all.clone();
            images.iter_mut().for_each(|signs| signs[*axis] = -1.0);
            all.extend(images);
        }
        all
    }

    /// Whether a place is free.
    pub fn is_free(&self, place_m: &Vector3<f64>) -> bool {
        self.keep_out.iter().all(|ball| (place_m - ball.centre_m).norm() >= ball.radius_m * (1.0 - SLACK))
    }

    /// Whether two elements keep their distance.
    pub(super) fn apart(&self, a: &LayoutElement, b: &LayoutElement) -> bool {
        (place(a) - place(b)).norm() >= self.spacing_m * (1.0 - SLACK)
    }

    /// The orbit of element `first`: each image among the `elements` that are not `taken`, once. `None` where one is missing.
    fn orbit(&self, elements: &[LayoutElement], taken: &[bool], first: usize) -> Option<Vec<Image>> {
        let mut orbit: Vec<Image> = Vec::with_capacity(self.orbit_len());
        let own = &elements[first];
        for signs in self.signs() {
            let wanted = place(own).component_mul(&Vector3::from(signs));
            let is_image = |e: &LayoutElement| {
                e.kind == own.kind
                    && (place(e) - wanted).norm() < SAME_PLACE_M
                    && e.world_from_element.rotation.angle_to(&own.world_from_element.rotation)
                        < SAME_TURN_RAD
            };
            // Two elements may stand at one place: the first image is the element itself, the others are nobody else's yet.
            if orbit.is_empty() || is_image(own) {
                if orbit.is_empty() {
                    orbit.push((first, signs));
                }
                continue;
            }
            let is_free = |i: &usize| !taken[*i] && orbit.iter().all(|(other, _)| other != i);
            let image = (0..elements.len()).filter(is_free).find(|i| is_image(&elements[*i]))?;
            orbit.push((image, signs));
        }
        Some(orbit)
    }

    /// Candidates in orbits, each of full size and with its own spacing kept; those without a full orbit are left out.
    pub(super) fn orbits_of_candidates(&self, candidates: &[LayoutElement]) -> Vec<Vec<usize>> {
        let mut taken = vec![false; candidates.len()];
        let mut all = Vec::new();
        for first in 0..candidates.len() {
            if taken[first] {
                continue;
            }
            let Some(orbit) = self.orbit(candidates, &taken, first) else { continue };
            let members: Vec<usize> = orbit.iter().map(|(i, _)| *i).collect();
            members.iter().for_each(|i| taken[*i] = true);
            let pairs =
                members.iter().enumerate().flat_map(|(k, i)| members[..k].iter().map(move |j| (*i, *j)));
            let keeps = pairs.into_iter().all(|(i, j)| self.apart(&candidates[i], &candidates[j]));
            if members.len() == self.orbit_len() && keeps {
                all.push(members);
            }
        }
        all
    }

    /// Installed elements in orbits; one on a mirror plane is its own image.
    pub(super) fn orbits_installed(
        &self,
        elements: &[LayoutElement],
    ) -> Result<Vec<Vec<Image>>, LayoutError> {
        let mut taken = vec![false; elements.len()];
        let mut all = Vec::new();
        for first in 0..elements.len() {
            if taken[first] {
                continue;
            }
            let orbit = self.orbit(elements, &taken, first).ok_or_else(|| {
                LayoutError::Impossible(format!(
                    "`{}` has no mirror image among the installed elements; a layout that is to be symmetric starts from one that is",
                    elements[first].name
                ))
            })?;
            orbit.iter().for_each(|(i, _)| taken[*i] = true);
            all.push(orbit);
        }
        Ok(all)
    }

    /// What a message says of it.
    pub(super) fn words(&self) -> String {
        let mut words = vec![format!("a spacing of {} mm", 1e3 * self.spacing_m)];
        if !self.keep_out.is_empty() {
            words.push(format!("{} places that are kept free", self.keep_out.len()));
        }
        if !self.mirrored.is_empty() {
            words.push(format!("{} mirror planes", self.mirrored.len()));
        }
        words.join(", ")
    }
}

impl Question<'_> {
    /// Whether an element stands where it may and gives a reading at every pose.
    pub(super) fn is_usable(&self, element: &LayoutElement) -> bool {
        self.sites.is_free(&place(element)) && self.reads_everywhere(element)
    }

    /// Whether an element gives a reading at every pose.
    pub(super) fn reads_everywhere(&self, element: &LayoutElement) -> bool {
        self.poses.iter().all(|pose| self.model.blocked(element, pose).is_none())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Translation3;

    fn at(x: f64, y: f64) -> LayoutElement {
        LayoutElement {
            name: "s".to_owned(),
            world_from_element: Translation3::new(x, y, 0.1).into(),
            kind: 0,
            cost: 1.0,
        }
    }

    #[test]
    fn closed_form_orbits_of_one_and_two_mirrors() {
        let elements =
            [at(1.0, 2.0), at(-1.0, 2.0), at(0.0, 1.0), at(1.0, -2.0), at(-1.0, -2.0), at(3.0, 3.0)];
        let one = Sites { mirrored: vec![0], ..Sites::default() };
        // The third is its own image, the last has none.
        assert_eq!(one.orbits_of_candidates(&elements), [vec![0, 1], vec![3, 4]]);
        let two = Sites { mirrored: vec![0, 1], ..Sites::default() };
        assert_eq!(two.orbits_of_candidates(&elements), [vec![0, 1, 3, 4]]);
        let near = Sites { mirrored: vec![0], spacing_m: 2.1, ..Sites::default() };
        assert!(near.orbits_of_candidates(&elements).is_empty());
        let installed = one.orbits_installed(&elements[..5]).unwrap();
        assert_eq!(installed[0], [(0, [1.0; 3]), (1, [-1.0, 1.0, 1.0])]);
        assert_eq!(installed[1], [(2, [1.0; 3])]);
        assert!(one.orbits_installed(&elements).unwrap_err().to_string().contains("no mirror image"));
        // Two at one place, turned differently, are two; without a mirror each stands for itself.
        let mut turned = at(1.0, 2.0);
        turned.world_from_element.rotation = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0);
        let twins = [at(1.0, 2.0), turned, at(1.0, 2.0), at(-1.0, 2.0)];
        assert_eq!(Sites::default().orbits_of_candidates(&twins).len(), 4);
        assert_eq!(one.orbits_of_candidates(&twins), [vec![0, 3]]);
        let free = Sites { keep_out: vec![KeepOut { centre_m: Vector3::zeros(), radius_m: 2.0 }], ..one };
        assert!(free.is_free(&Vector3::new(2.0, 0.0, 0.0)) && !free.is_free(&Vector3::new(1.9, 0.0, 0.0)));
    }
}
