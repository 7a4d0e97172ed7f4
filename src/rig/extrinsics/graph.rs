//! Frames that hang in each other, and where one sits in the platform's.

use std::collections::{BTreeMap, BTreeSet};

use super::super::NamedFrame;
use super::super::frames::BASE;
use crate::base::geometry::Pose;

/// A robot has fewer frames.
const MOST_FRAMES: usize = 4096;

/// Frames by name, each with its place in its parent.
pub(super) struct Graph<'a> {
    links: BTreeMap<&'a str, &'a NamedFrame>,
    parents: BTreeSet<&'a str>,
    base: &'a str,
}

impl<'a> Graph<'a> {
    /// # Errors
    /// No frames, one with two parents, or no single frame from which all hang, in words.
    pub(super) fn new(links: &'a [NamedFrame]) -> Result<Self, String> {
        if links.len() > MOST_FRAMES {
            return Err(format!("{} frames, expected at most {MOST_FRAMES}", links.len()));
        }
        let mut by_name = BTreeMap::new();
        for link in links {
            if link.name == link.parent {
                return Err(format!("frame {:?} is its own parent", link.name));
            }
            if let Some(before) = by_name.insert(link.name.as_str(), link) {
                return Err(format!(
                    "frame {:?} is described twice, in {:?} and in {:?}: leave one out, or rename it",
                    link.name, before.parent, link.parent
                ));
            }
        }
        let parents: BTreeSet<&str> = links.iter().map(|link| link.parent.as_str()).collect();
        let roots: Vec<&str> = parents.iter().copied().filter(|name| !by_name.contains_key(name)).collect();
        let base = match (parents.contains(BASE) || by_name.contains_key(BASE), &roots[..]) {
            (true, _) => BASE,
            (false, [root]) => root,
            (false, []) => {
                return Err("the frames hang in a circle, expected one from which all others hang".into());
            }
            (false, roots) => {
                return Err(format!(
                    "the frames hang from {}, expected one platform: call it {BASE}",
                    roots.join(" and ")
                ));
            }
        };
        Ok(Self { links: by_name, parents, base })
    }

    /// Whether no frame hangs from this one.
    pub(super) fn is_leaf(&self, frame: &str) -> bool {
        !self.parents.contains(frame)
    }

    /// Where a frame sits in the platform's.
    ///
    /// # Errors
    /// It does not hang from it, in words.
    pub(super) fn base_from(&self, frame: &str) -> Result<Pose, String> {
        let up = |from: &str| -> Result<(Vec<String>, Pose), String> {
            let (mut pose, mut at, mut passed) = (Pose::IDENTITY, from, vec![from.to_owned()]);
            while let Some(link) = self.links.get(at) {
                pose = link.parent_from_frame * pose;
                at = &link.parent;
                if passed.len() > self.links.len() {
                    return Err(format!("frame {from:?} hangs in a circle through {at:?}"));
                }
                passed.push(at.to_owned());
            }
            Ok((passed, pose))
        };
        let (passed, root_from_frame) = up(frame)?;
        let (base_passed, root_from_base) = up(self.base)?;
        if passed.last() != base_passed.last() {
            return Err(format!(
                "frame {frame:?} hangs from {:?}, not from {:?}: the transform between them is missing",
                passed.last().map_or("", String::as_str),
                self.base
            ));
        }
        Ok(root_from_base.inverse() * root_from_frame)
    }
}
