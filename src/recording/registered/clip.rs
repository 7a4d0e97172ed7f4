//! A box in which points are wanted.

use std::str::FromStr;

use glam::DVec3;

/// A box that may be turned about the vertical through its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ClipBox {
    centre_m: DVec3,
    half_m: DVec3,
    /// Sine and cosine of the turn, counterclockwise seen from above.
    turn: [f64; 2],
}

impl ClipBox {
    pub(crate) fn contains(&self, point_m: DVec3) -> bool {
        let [sin, cos] = self.turn;
        let DVec3 { x, y, z } = point_m - self.centre_m;
        DVec3::new(cos * x + sin * y, cos * y - sin * x, z).abs().cmple(self.half_m).all()
    }
}

impl FromStr for ClipBox {
    type Err = String;

    /// `x,y,z,x,y,z` or `x,y,z,x,y,z@yaw_deg`: minimum and maximum corner before it is turned.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("{text:?}: expected x,y,z,x,y,z in metres, or x,y,z,x,y,z@YAW in metres and degrees");
        let (corners, yaw) = text.split_once('@').unwrap_or((text, "0"));
        let number = |text: &str| text.trim().parse().ok().filter(|value: &f64| value.is_finite());
        let corners: Option<Vec<f64>> = corners.split(',').map(number).collect();
        let [x0, y0, z0, x1, y1, z1] = corners.ok_or_else(wrong)?[..] else { return Err(wrong()) };
        let yaw_rad = number(yaw).ok_or_else(wrong)?.to_radians();
        let [low_m, high_m] = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
        if !low_m.cmplt(high_m).all() {
            return Err(format!("{text:?}: the first corner must lie below the second in x, y and z"));
        }
        let (sin, cos) = yaw_rad.sin_cos();
        Ok(Self { centre_m: 0.5 * (low_m + high_m), half_m: 0.5 * (high_m - low_m), turn: [sin, cos] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_box_holds_what_lies_in_it() {
        let plain: ClipBox = "0,0,0,4,2,1".parse().unwrap();
        let turned: ClipBox = "0,0,0,4,2,1@90".parse().unwrap();
        for (x, y, in_plain, in_turned) in [
            (3.9, 1.0, true, false),
            (2.0, 2.9, false, true),
            (2.0, -0.9, false, true),
            (2.0, 1.0, true, true),
        ] {
            let point_m = DVec3::new(x, y, 0.5);
            assert_eq!((plain.contains(point_m), turned.contains(point_m)), (in_plain, in_turned), "{x} {y}");
        }
        let slightly: ClipBox = "0,0,0,4,2,1@10".parse().unwrap();
        // counterclockwise: the far end rises in y
        assert!(
            slightly.contains(DVec3::new(3.7, 2.0, 0.5)) && !slightly.contains(DVec3::new(3.7, 0.1, 0.5))
        );
        for wrong in
            ["", "1,2,3", "0,0,0,1,1,x", "0,0,0,1,1,0", "0,0,0,1,1,1@", "0,0,0,1,1,inf", "0,0,0,1,1,1,1"]
        {
            assert!(wrong.parse::<ClipBox>().is_err(), "{wrong}");
        }
    }
}
