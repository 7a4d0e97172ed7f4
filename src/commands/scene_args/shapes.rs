//! Numbers with commas between them, and what they describe: a room, the operator.

use glam::DVec3;

use crate::simulate::occluder::Occluder;
use crate::world::scene::{BoxScene, Scene};

/// So many finite numbers, separated by commas.
#[derive(Clone, Copy, Debug)]
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<const N: usize> std::str::FromStr for Numbers<N> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> =
            text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let numbers = numbers.ok_or("every part must be a finite number")?;
        let found = numbers.len();
        numbers.try_into().map(Self).map_err(|_| format!("{found} numbers, expected {N}"))
    }
}

/// The operator of a rig: a capsule in the body frame.
#[derive(Clone, Copy, Debug)]
pub struct Operator(pub Occluder);

impl std::str::FromStr for Operator {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Numbers([x0, y0, z0, x1, y1, z1, radius_m]) = text.parse()?;
        if radius_m <= 0.0 {
            return Err(format!("the radius is {radius_m} m, expected above 0"));
        }
        let [from_m, to_m] = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
        Ok(Self(Occluder::Capsule { from_m, to_m, radius_m }))
    }
}

/// Longest edge of a room, m: its walls are counted in voxels.
const LONGEST_ROOM_M: f64 = 10_000.0;

/// A closed room by its min and its max corner.
#[derive(Clone, Copy, Debug)]
pub struct Room([DVec3; 2]);

impl Room {
    /// Six walls, seen from within.
    pub(crate) fn scene(&self) -> Scene {
        let Self([low_m, high_m]) = *self;
        Scene::Box(BoxScene::closed(low_m, high_m))
    }
}

impl std::str::FromStr for Room {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Numbers([x0, y0, z0, x1, y1, z1]) = text.parse()?;
        let [low_m, high_m] = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
        if !low_m.cmplt(high_m).all() {
            return Err("the first corner must lie below the second in x, y and z".into());
        }
        if (high_m - low_m).max_element() > LONGEST_ROOM_M
            || low_m.abs().max(high_m.abs()).max_element() > 1e8
        {
            return Err(format!("expected a room of {LONGEST_ROOM_M} m at most, within 1e8 m of 0"));
        }
        Ok(Self([low_m, high_m]))
    }
}
