//! Named points over two logarithmic axes, the front of those that none beats marked: cost against error.

use std::fmt::Write as _;

use super::axis::Axis;
use super::{escape, metadata};

/// A chart of named points; less is better on both axes. What is not above zero cannot be shown on a logarithm and
/// stands on the chart's edge, as at most what the edge says.
#[derive(Clone, Debug, Default)]
pub struct ScatterChart {
    /// What the picture shows, for readers and screen readers.
    pub title: String,
    /// Label of the x axis, with unit.
    pub x_label: String,
    /// Label of the y axis, with unit.
    pub y_label: String,
    /// Points.
    pub points: Vec<NamedPoint>,
}

/// A point with its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedPoint {
    /// Written next to it.
    pub name: String,
    /// Place along x and y.
    pub at: [f64; 2],
    /// Class of colour: 0 to 5.
    pub group: usize,
}

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 420.0;
const LEFT: f64 = 72.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 18.0;
const BOTTOM: f64 = 44.0;
const RADIUS: f64 = 4.0;
/// Of a name: height, and width of a letter of the page's small type, px.
const TEXT: [f64; 2] = [12.0, 6.2];

impl ScatterChart {
    /// Numbers of the points that no other beats: none costs at most as much and errs less, ascending in x.
    pub(crate) fn front(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        let at = |index: usize| self.points[index].at;
        order.sort_by(|a, b| at(*a)[0].total_cmp(&at(*b)[0]).then(at(*a)[1].total_cmp(&at(*b)[1])));
        let mut least = f64::INFINITY;
        order.retain(|index| {
            let is_better = at(*index)[1] < least;
            least = least.min(at(*index)[1]);
            is_better
        });
        order
    }

    /// The picture.
    pub(crate) fn svg(&self) -> String {
        let x = Axis::decades(self.points.iter().map(|point| point.at[0]), LEFT, WIDTH - RIGHT);
        let y = Axis::decades(self.points.iter().map(|point| point.at[1]), HEIGHT - BOTTOM, TOP);
        let mut svg = format!(
            "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">",
            escape(&self.title)
        );
        for (at, label) in y.ticks() {
            let _ = write!(svg, "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{:.1}\"/>", WIDTH - RIGHT);
            let label = text(&label, LEFT - 6.0, at + 4.0, "end");
            svg += &label;
        }
        for (at, label) in x.ticks() {
            let _ = write!(svg, "<path class=\"grid\" d=\"M{at:.1} {TOP}V{:.1}\"/>", HEIGHT - BOTTOM);
            svg += &text(&label, at, HEIGHT - BOTTOM + 17.0, "middle");
        }
        svg += &text(&escape(&self.x_label), (LEFT + WIDTH - RIGHT) / 2.0, HEIGHT - 8.0, "middle");
        let _ = write!(
            svg,
            "<text transform=\"translate(14 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            (HEIGHT - BOTTOM + TOP) / 2.0,
            escape(&self.y_label)
        );
        let places: Vec<[f64; 2]> =
            self.points.iter().map(|point| [x.px(point.at[0]), y.px(point.at[1])]).collect();
        let front = self.front();
        let mut occupied: Vec<Room> = places.iter().map(|place| Room::of_point(*place)).collect();
        let mut path = String::new();
        for pair in front.windows(2) {
            let [[from_x, from_y], [to_x, to_y]] = [places[pair[0]], places[pair[1]]];
            if path.is_empty() {
                let _ = write!(path, "M{from_x:.1} {from_y:.1}");
            }
            let _ = write!(path, "H{to_x:.1}V{to_y:.1}");
            let (top, bottom) = (from_y.min(to_y), from_y.max(to_y));
            occupied.push(Room { left: from_x, right: to_x, top: from_y - 1.0, bottom: from_y + 1.0 });
            occupied.push(Room { left: to_x - 1.0, right: to_x + 1.0, top, bottom });
        }
        let _ = write!(svg, "<path class=\"line s0\" d=\"{path}\"/>");
        for (index, point) in self.points.iter().enumerate() {
            let [px, py] = places[index];
            let hollow = if front.contains(&index) { "" } else { " hollow" };
            let _ = write!(
                svg,
                "<circle class=\"point s{}{hollow}\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"{RADIUS}\"/>",
                point.group % 6
            );
        }
        let (mut names, mut leaders): (Vec<Room>, Vec<Room>) = (Vec::new(), Vec::new());
        // names of the front first: they must not be the ones left without room
        let mut order = front.clone();
        order.extend((0..self.points.len()).filter(|index| !front.contains(index)));
        for index in order {
            let name = &self.points[index].name;
            let [px, py] = places[index];
            // nearby points that hide it in part would be crossed by any line
            let others = places.iter().filter(|[x, y]| (x - px).hypot(y - py) > 2.0 * RADIUS);
            let others = others.map(|place| Room::of_point(*place));
            let clear: Vec<Room> = names.iter().copied().chain(others).collect();
            let (room, is_far) = Room::of_name([px, py], name, &occupied, [&clear, &leaders]);
            if is_far {
                let [to_x, to_y] = room.nearest([px, py]);
                let _ = write!(svg, "<path class=\"leader\" d=\"M{px:.1} {py:.1}L{to_x:.1} {to_y:.1}\"/>");
                leaders.extend(Room::along([px, py], [to_x, to_y]));
            }
            svg += &text(&escape(name), room.left, room.bottom - 2.5, "start");
            occupied.push(room);
            names.push(room);
        }
        let rows = self.points.iter().map(|point| (point.name.as_str(), point.at));
        svg += &metadata(["name", &self.x_label, &self.y_label], rows);
        svg.push_str("</svg>");
        svg
    }
}

fn text(words: &str, x: f64, y: f64, anchor: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>")
}

/// A rectangle of the picture that holds something.
#[derive(Clone, Copy, Debug)]
struct Room {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

impl Room {
    fn of_point([x, y]: [f64; 2]) -> Self {
        let r = RADIUS + 1.0;
        Self { left: x - r, right: x + r, top: y - r, bottom: y + r }
    }

    /// The free room nearest to a point, and whether it lies so far off that a line must lead to it. Where there is one, it
    /// is such that lines cross no name and no other point.
    fn of_name([x, y]: [f64; 2], name: &str, occupied: &[Self], drawn: [&[Self]; 2]) -> (Self, bool) {
        let [clear, leaders] = drawn;
        let [height, letter] = TEXT;
        let width = letter * name.chars().count() as f64;
        let at = |left: f64, middle: f64| Self {
            left,
            right: left + width,
            top: middle - height / 2.0,
            bottom: middle + height / 2.0,
        };
        let rings = |ring: u32| {
            let away = RADIUS + 4.0 + 9.0 * f64::from(ring);
            let sides = [
                at(x + away, y),
                at(x - away - width, y),
                at(x - width / 2.0, y - away - 3.0),
                at(x - width / 2.0, y + away + 3.0),
                at(x + away, y - away),
                at(x + away, y + away),
                at(x - away - width, y - away),
                at(x - away - width, y + away),
            ];
            sides.map(|room| (room, ring > 1))
        };
        let leads = |room: &Self| Self::along([x, y], room.nearest([x, y]));
        let is_crossed = |room: &Self, is_far: bool| {
            leaders.iter().any(|step| step.meets(room))
                || is_far && leads(room).any(|step| clear.iter().any(|other| step.meets(other)))
        };
        let rooms = (0..24).flat_map(rings);
        let free: Vec<(Self, bool)> = rooms
            .filter(|(room, _)| room.is_inside() && !occupied.iter().any(|other| room.meets(other)))
            .collect();
        let uncrossed = free.iter().find(|(room, is_far)| !is_crossed(room, *is_far));
        uncrossed.or(free.first()).copied().unwrap_or((at(x + RADIUS + 4.0, y), false))
    }

    fn is_inside(&self) -> bool {
        self.left >= LEFT && self.right <= WIDTH - 2.0 && self.top >= 0.0 && self.bottom <= HEIGHT - BOTTOM
    }

    /// Its place nearest to a point.
    fn nearest(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x.clamp(self.left, self.right), y.clamp(self.top, self.bottom)]
    }

    /// Small rooms along a line.
    fn along([from_x, from_y]: [f64; 2], [to_x, to_y]: [f64; 2]) -> impl Iterator<Item = Self> {
        let steps = ((to_x - from_x).hypot(to_y - from_y) / 2.0).ceil().max(1.0);
        (0..=steps as u32).map(move |step| {
            let share = f64::from(step) / steps;
            let (x, y) = (from_x + share * (to_x - from_x), from_y + share * (to_y - from_y));
            Self { left: x - 1.0, right: x + 1.0, top: y - 1.0, bottom: y + 1.0 }
        })
    }

    fn meets(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(name: &str, at: [f64; 2]) -> NamedPoint {
        NamedPoint { name: name.into(), at, group: 0 }
    }

    #[test]
    fn the_front_is_what_none_beats() {
        let points = vec![
            point("dear and bad", [100.0, 5.0]),
            point("cheap", [1.0, 5.0]),
            point("good", [50.0, 0.1]),
            point("between", [10.0, 1.0]),
            point("as good, dearer", [60.0, 0.1]),
        ];
        let chart = ScatterChart { points, ..ScatterChart::default() };
        assert_eq!(chart.front(), [1, 3, 2]);
    }

    #[test]
    fn names_find_rooms_of_their_own() {
        let points: Vec<NamedPoint> = (0..14)
            .map(|n| {
                point(
                    &format!("point number {n}"),
                    [10.0 + f64::from(n % 4) * 0.3, 1.0 + f64::from(n) * 0.02],
                )
            })
            .collect();
        let chart = ScatterChart { points, ..ScatterChart::default() };
        let svg = chart.svg();
        let mut rooms: Vec<Room> = Vec::new();
        for part in svg.split("<text ").skip(1).filter(|part| part.contains("point number")) {
            let field = |name: &str| -> f64 {
                part.split(name).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
            };
            // written with one decimal
            let (left, bottom) = (field("x=\"") + 0.1, field("y=\"") + 2.5 - 0.1);
            let words = part.split('>').nth(1).unwrap().split('<').next().unwrap();
            let right = left + TEXT[1] * words.chars().count() as f64 - 0.2;
            rooms.push(Room { left, right, top: bottom - TEXT[0] + 0.2, bottom });
        }
        assert_eq!(rooms.len(), 14);
        for (index, room) in rooms.iter().enumerate() {
            assert!(rooms[index + 1..].iter().all(|other| !room.meets(other)), "{room:?}");
        }
    }

    #[test]
    fn a_line_to_a_name_crosses_no_other_name() {
        let block = Room { left: 100.0, right: 320.0, top: 100.0, bottom: 300.0 };
        let right = Room { left: 322.0, right: 400.0, top: 100.0, bottom: 300.0 };
        let of_name = |names: &[Room], leaders: &[Room]| {
            let (room, is_far) =
                Room::of_name([300.0, 200.0], "eleven long", &[block, right], [names, leaders]);
            assert!(is_far);
            room
        };
        assert!(of_name(&[], &[]).left > 400.0, "behind what is no name");
        assert!(of_name(&[right], &[]).bottom < 100.0, "above");
        let leader: Vec<Room> = Room::along([200.0, 90.0], [400.0, 90.0]).collect();
        assert!(of_name(&[right], &leader).top > 300.0, "below");
    }

    #[test]
    fn nothing_and_zero_can_be_drawn() {
        let empty = ScatterChart::default().svg();
        assert!(empty.ends_with("</svg>") && !empty.contains("NaN"));
        let zero =
            ScatterChart { points: vec![point("<exact>", [3.0, 0.0])], ..ScatterChart::default() }.svg();
        assert!(zero.contains("&lt;exact&gt;") && !zero.contains("NaN") && !zero.contains("inf"));
    }
}
