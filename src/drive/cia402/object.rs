//! The objects of a drive that are used here, and questions for objects (CiA 301, 7.2.4: SDO; CiA 402-2: drives).

/// Index, sub-index, bytes.
pub type Object = (u16, u8, u8);

/// What it is: the lower half is 402 for drives.
pub const DEVICE_TYPE: Object = (0x1000, 0, 4);
/// Heartbeat that the drive watches: node << 16 | ms.
pub const WATCHED_HEARTBEAT: Object = (0x1016, 1, 4);
/// Period of its own heartbeat, ms.
pub const HEARTBEAT_PERIOD: Object = (0x1017, 0, 2);
/// Why it is at fault.
pub const ERROR_CODE: Object = (0x603F, 0, 2);
/// Mode of operation.
pub const MODE: Object = (0x6060, 0, 1);
/// Mode of operation that it is in.
pub const MODE_NOW: Object = (0x6061, 0, 1);
/// How it finds its zero.
pub const HOMING_METHOD: Object = (0x6098, 0, 1);
/// Rated current, mA.
pub const RATED_CURRENT: Object = (0x6075, 0, 4);
/// Current, thousandths of the rated one.
pub const CURRENT: Object = (0x6078, 0, 2);
/// Supply, mV.
pub const SUPPLY: Object = (0x6079, 0, 4);
/// Position, increments of the encoder.
pub const INCREMENTS: Object = (0x6063, 0, 4);
/// Lowest and highest position, position units; both 0 is none.
pub const SOFTWARE_LIMITS: u16 = 0x607D;
/// Lowest and highest position before it wraps to the other end, position units; both 0 is none.
pub const RANGE_LIMITS: u16 = 0x607B;
/// Increments of the encoder, turns of the motor.
pub const ENCODER: u16 = 0x608F;
/// Turns of the motor, turns of the shaft.
pub const GEAR: u16 = 0x6091;
/// Position units, turns of the shaft.
pub const FEED: u16 = 0x6092;
/// Increments of the encoder, position units.
pub const POSITION_FACTOR: u16 = 0x6093;
/// What a position unit is: prefix << 24 | code << 16.
pub const POSITION_UNIT: Object = (0x60A8, 0, 4);
/// Added to each target, position units.
pub const POSITION_OFFSET: Object = (0x60B0, 0, 4);
/// What it does when the host's heartbeat stays away.
pub const ON_LOST_HOST: Object = (0x6007, 0, 2);
pub const QUICK_STOP: u32 = 3;
pub const ON_QUICK_STOP: Object = (0x605A, 0, 2);
/// ... brake, then hold with torque.
pub const BRAKE_AND_HOLD: u32 = 6;
/// Bits of modes it has.
pub const SUPPORTED_MODES: Object = (0x6502, 0, 4);
/// Cyclic synchronous position: a set point with every SYNC.
pub const CYCLIC_POSITION: u32 = 8;
/// Homing: it finds its zero by itself.
pub const HOMING: u32 = 6;
/// Homing methods that find nothing: none, and those that call zero where the shaft happens to stand (CiA 402-2, methods 35
/// and 37). A sensor that hangs crooked would be level by them.
pub const METHODS_WITHOUT_MOTION: [u8; 3] = [0, 35, 37];

/// Writes that make RPDO 1 control word and target, and TPDO 1 status word and position, both with every SYNC. Those of a
/// PDO's identifier carry the node's number.
pub(crate) fn process_data(node: u8) -> [(Object, u32); 14] {
    let (rpdo, tpdo) = (0x200 + u32::from(node), 0x180 + u32::from(node));
    let off = 1 << 31;
    [
        ((0x1400, 1, 4), rpdo | off),
        ((0x1600, 0, 1), 0),
        ((0x1600, 1, 4), 0x6040_0010),
        ((0x1600, 2, 4), 0x607A_0020),
        ((0x1600, 0, 1), 2),
        ((0x1400, 2, 1), 1),
        ((0x1400, 1, 4), rpdo),
        ((0x1800, 1, 4), tpdo | off),
        ((0x1A00, 0, 1), 0),
        ((0x1A00, 1, 4), 0x6041_0010),
        ((0x1A00, 2, 4), 0x6064_0020),
        ((0x1A00, 0, 1), 2),
        ((0x1800, 2, 1), 1),
        ((0x1800, 1, 4), tpdo),
    ]
}

/// A question for an object.
pub(crate) fn upload((index, sub, _): Object) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    [0x40, low, high, sub, 0, 0, 0, 0]
}

/// A new value for an object, in one message.
pub(crate) fn download((index, sub, bytes): Object, value: u32) -> [u8; 8] {
    let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
    [0x23 | (4 - bytes.clamp(1, 4)) << 2, low, high, sub, a, b, c, d]
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The value asked for.
    Value(u32),
    /// The new value is set.
    Written,
    /// No, and why (CiA 301, table 22).
    Abort(u32),
}

/// What a message answers to a question for this object; `None` when it answers another.
pub(crate) fn answer((index, sub, _): Object, data: &[u8]) -> Option<Answer> {
    let [command, low, high, theirs, a, b, c, d] = *data else { return None };
    if (u16::from_le_bytes([low, high]), theirs) != (index, sub) {
        return None;
    }
    let value = u32::from_le_bytes([a, b, c, d]);
    match command >> 5 {
        // expedited, and how many bytes of the four are none of the value
        2 if command & 0b10 != 0 => {
            let unused = if command & 1 != 0 { u32::from(command >> 2 & 3) } else { 0 };
            Some(Answer::Value(value & u32::MAX >> (8 * unused)))
        }
        3 => Some(Answer::Written),
        4 => Some(Answer::Abort(value)),
        _ => None,
    }
}

/// An abort in words.
pub(crate) fn abort_name(code: u32) -> &'static str {
    match code {
        0x0504_0000 => "it timed out",
        0x0601_0000..=0x0601_0002 => "no access",
        0x0602_0000 => "no such object",
        0x0604_0041..=0x0604_0043 => "the object cannot be mapped so",
        0x0606_0000 => "hardware error",
        0x0607_0010..=0x0607_0013 => "wrong length",
        0x0609_0011 => "no such sub-index",
        0x0609_0030..=0x0609_0036 => "value out of range",
        0x0800_0020..=0x0800_0022 => "not in this state",
        _ => "refused",
    }
}

/// An error code in words (CiA 402-2, "Error code").
pub(crate) fn error_name(code: u16) -> &'static str {
    match code {
        0x2000..=0x2FFF => "current",
        0x3210 => "supply too high",
        0x3220 => "supply too low",
        0x3000..=0x3FFF => "voltage",
        0x4000..=0x4FFF => "temperature",
        0x5000..=0x5FFF => "device hardware",
        0x6000..=0x6FFF => "device software",
        0x7300..=0x73FF => "position sensor",
        0x7000..=0x7FFF => "additional modules",
        0x8130 => "the host's heartbeat stayed away",
        0x8100..=0x81FF => "communication",
        0x8611 => "following error",
        0x8000..=0x8FFF => "monitoring",
        _ => "unknown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn questions_and_answers_have_the_standards_bytes() {
        assert_eq!(upload(DEVICE_TYPE), [0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
        assert_eq!(download(MODE, 8), [0x2F, 0x60, 0x60, 0, 8, 0, 0, 0]);
        assert_eq!(download(HEARTBEAT_PERIOD, 100), [0x2B, 0x17, 0x10, 0, 100, 0, 0, 0]);
        assert_eq!(download((SOFTWARE_LIMITS, 1, 4), 0xFFFF_FFFF), [0x23, 0x7D, 0x60, 1, 255, 255, 255, 255]);
        let value = |data| answer(DEVICE_TYPE, data);
        assert_eq!(value(&[0x43, 0x00, 0x10, 0, 0x92, 0x01, 0x02, 0x00]), Some(Answer::Value(0x0002_0192)));
        assert_eq!(value(&[0x4B, 0x00, 0x10, 0, 0x92, 0x01, 0xFF, 0xFF]), Some(Answer::Value(0x0192)));
        assert_eq!(value(&[0x60, 0x00, 0x10, 0, 0, 0, 0, 0]), Some(Answer::Written));
        assert_eq!(value(&[0x80, 0x00, 0x10, 0, 0, 0, 2, 6]), Some(Answer::Abort(0x0602_0000)));
        assert_eq!(value(&[0x43, 0x01, 0x10, 0, 0, 0, 0, 0]), None, "another object's answer");
        assert_eq!(value(&[0x43, 0x00]), None);
    }
}
