//! Which column of a table of poses holds what: by the names in its header, as ROS tools, EuRoC and spreadsheets write them.

use super::stamp::TimeUnit;

/// Where the numbers of a pose stand in a row, from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Columns {
    pub time: TimeColumns,
    /// x, y, z.
    pub position: [usize; 3],
    /// x, y, z, w.
    pub quaternion: [usize; 4],
}

/// Where the time stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum TimeColumns {
    One {
        column: usize,
        unit: Option<TimeUnit>,
    },
    /// Whole seconds, and nanoseconds beyond them.
    Split {
        seconds: usize,
        nanoseconds: usize,
    },
}

/// What a column holds, by its name.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Time(Option<TimeUnit>),
    Seconds,
    Nanoseconds,
    Position(usize),
    Quaternion(usize),
}

impl Columns {
    /// `timestamp tx ty tz qx qy qz qw`.
    pub const TUM: Self = Self {
        time: TimeColumns::One { column: 0, unit: None },
        position: [1, 2, 3],
        quaternion: [4, 5, 6, 7],
    };
    /// `timestamp [ns], position, quaternion (w first), velocity, biases`.
    pub const EUROC: Self = Self {
        time: TimeColumns::One { column: 0, unit: None },
        position: [1, 2, 3],
        quaternion: [5, 6, 7, 4],
    };

    /// From the names of a header; what it lacks where it names no pose.
    pub(crate) fn named(names: &[String]) -> Result<Self, String> {
        let kinds: Vec<Option<Kind>> = names.iter().map(|name| kind(name)).collect();
        let find = |wanted: Kind| kinds.iter().position(|kind| *kind == Some(wanted));
        let one = kinds.iter().enumerate().find_map(|(column, kind)| match kind {
            Some(Kind::Time(unit)) => Some(TimeColumns::One { column, unit: *unit }),
            _ => None,
        });
        let split = find(Kind::Seconds).zip(find(Kind::Nanoseconds));
        let split = split.map(|(seconds, nanoseconds)| TimeColumns::Split { seconds, nanoseconds });
        let seconds =
            find(Kind::Seconds).map(|column| TimeColumns::One { column, unit: Some(TimeUnit::Second) });
        let time = one.or(split).or(seconds).ok_or("a time (timestamp)")?;
        let all = |kind: fn(usize) -> Kind, count: usize| -> Option<Vec<usize>> {
            (0..count).map(|part| find(kind(part))).collect()
        };
        let position = all(Kind::Position, 3).ok_or("a position (x, y, z)")?;
        let quaternion = all(Kind::Quaternion, 4).ok_or("an attitude as a quaternion (qx, qy, qz, qw)")?;
        Ok(Self {
            time,
            position: [position[0], position[1], position[2]],
            quaternion: [quaternion[0], quaternion[1], quaternion[2], quaternion[3]],
        })
    }

    /// Fields that a row must have.
    pub(crate) fn needed(&self) -> usize {
        let time = match self.time {
            TimeColumns::One { column, .. } => column,
            TimeColumns::Split { seconds, nanoseconds } => seconds.max(nanoseconds),
        };
        self.position.into_iter().chain(self.quaternion).fold(time, usize::max) + 1
    }
}

fn kind(name: &str) -> Option<Kind> {
    const OF_MOTION: [&str; 16] = [
        "v",
        "vel",
        "velocity",
        "linear",
        "angular",
        "twist",
        "b",
        "bias",
        "a",
        "acc",
        "accel",
        "covariance",
        "cov",
        "std",
        "sigma",
        "gyro",
    ];
    let lower = name.to_ascii_lowercase();
    let parts: Vec<&str> =
        lower.split(|letter: char| !letter.is_ascii_alphanumeric()).filter(|part| !part.is_empty()).collect();
    let (&last, before) = parts.split_last()?;
    let is_time = |part: &&str| ["timestamp", "time", "stamp", "t"].contains(part);
    if is_time(&last) {
        return Some(Kind::Time(None));
    }
    match last {
        "secs" | "sec" | "seconds" if before.iter().all(|part| !OF_MOTION.contains(part)) => {
            return Some(if before.last().is_some_and(|part| *part == "time" || *part == "timestamp") {
                Kind::Time(Some(TimeUnit::Second))
            } else {
                Kind::Seconds
            });
        }
        "nsecs" | "nanosec" | "nanosecs" => return Some(Kind::Nanoseconds),
        "nsec" if !before.last().is_some_and(is_time) => return Some(Kind::Nanoseconds),
        _ => {}
    }
    if let Some(unit) = TimeUnit::of_name(last)
        && before.last().is_some_and(is_time)
    {
        return Some(Kind::Time(Some(unit)));
    }
    let (last, before) = match (last, before.split_last()) {
        ("m" | "metres" | "meters", Some((last, before))) => (*last, before),
        _ => (last, before),
    };
    if parts.iter().any(|part| OF_MOTION.contains(part)) {
        return None;
    }
    let axis = |letter: &str| ["x", "y", "z", "w"].iter().position(|known| *known == letter);
    if let Some(letter) = last.strip_prefix('q').filter(|letter| letter.len() == 1) {
        return axis(letter).map(Kind::Quaternion);
    }
    let of = |names: &[&str]| before.iter().any(|part| names.contains(part));
    if of(&["q", "quat", "quaternion", "orientation", "rotation", "rot", "attitude"]) {
        return axis(last).map(Kind::Quaternion);
    }
    let letter =
        ["position", "pos", "p", "t"].iter().find_map(|prefix| last.strip_prefix(prefix)).unwrap_or(last);
    let is_position = before.is_empty()
        || of(&["p", "pos", "position", "t", "trans", "translation", "location", "xyz", "pose"]);
    axis(letter).filter(|part| *part < 3 && is_position).map(Kind::Position)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(header: &str) -> Result<Columns, String> {
        let names: Vec<String> = header.split(',').map(|name| name.trim().to_owned()).collect();
        Columns::named(&names)
    }

    #[test]
    fn headers_of_other_programs_name_their_columns() {
        let unit = |unit| TimeColumns::One { column: 0, unit };
        let euroc = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], \
                     v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_a_RS_S_x [m s^-2]";
        assert_eq!(named(euroc), Ok(Columns { time: unit(None), ..Columns::EUROC }));
        let euroc = euroc.replace("#timestamp", "#timestamp [ns]");
        assert_eq!(named(&euroc).unwrap().time, unit(Some(TimeUnit::Nanosecond)));
        let rostopic = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.child_frame_id,\
                        field.pose.pose.position.x,field.pose.pose.position.y,field.pose.pose.position.z,\
                        field.pose.pose.orientation.x,field.pose.pose.orientation.y,field.pose.pose.orientation.z,\
                        field.pose.pose.orientation.w,field.pose.covariance0,field.twist.twist.linear.x";
        let found = named(rostopic).unwrap();
        assert_eq!((found.position, found.quaternion), ([5, 6, 7], [8, 9, 10, 11]));
        let split = named("header.stamp.sec,header.stamp.nanosec,x,y,z,qw,qx,qy,qz").unwrap();
        assert_eq!(split.time, TimeColumns::Split { seconds: 0, nanoseconds: 1 });
        assert_eq!(split.quaternion, [6, 7, 8, 5]);
        assert_eq!(split.needed(), 9);
        let tum = named("timestamp,tx,ty,tz,qx,qy,qz,qw").unwrap();
        assert_eq!(tum, Columns::TUM);
        assert_eq!(
            named("t_ms,pos_x,pos_y,pos_z,qx,qy,qz,qw").unwrap().time,
            unit(Some(TimeUnit::Millisecond))
        );
        assert!(named("timestamp,x,y,z,roll,pitch,yaw").unwrap_err().contains("quaternion"));
        assert!(named("x,y,z,qx,qy,qz,qw").unwrap_err().contains("time"));
    }
}
