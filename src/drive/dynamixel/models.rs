//! Models with the control table of [`super::table`].
//!
//! Numbers: ROBOTIS `dynamixel_hardware_interface`, `param/dxl_model/dynamixel.model`, and for XW430-T200 its e-Manual page.
//! Units of register 126: the models' e-Manual pages. All count 4096 to the turn.

#[derive(Debug)]
pub struct Model {
    /// Register 0.
    pub number: u16,
    /// As printed on it.
    pub name: &'static str,
    /// One count of register 126, µA; 0 where that holds a load estimated from the voltage, which is no current.
    pub current_ua: i32,
}

const fn model(number: u16, name: &'static str, current_ua: i32) -> Model {
    Model { number, name, current_ua }
}

/// 2.69 mA.
const X: i32 = 2690;
/// 3.36 mA.
const MX: i32 = 3360;

/// Every known model.
const MODELS: [Model; 35] = [
    model(30, "MX-28 (2.0)", 0),
    model(311, "MX-64 (2.0)", MX),
    model(321, "MX-106 (2.0)", MX),
    model(1000, "XH430-W350", X),
    model(1001, "XD430-T350", X),
    model(1010, "XH430-W210", X),
    model(1011, "XD430-T210", X),
    model(1020, "XM430-W350", X),
    model(1030, "XM430-W210", X),
    model(1040, "XH430-V350", 1340),
    model(1050, "XH430-V210", 1340),
    model(1060, "XL430-W250", 0),
    model(1070, "XC430-W150", 0),
    model(1080, "XC430-W240", 0),
    model(1090, "2XL430-W250", 0),
    model(1100, "XH540-W270", X),
    model(1101, "XD540-T270", X),
    model(1110, "XH540-W150", X),
    model(1111, "XD540-T150", X),
    model(1120, "XM540-W270", X),
    model(1130, "XM540-W150", X),
    model(1140, "XH540-V270", X),
    model(1150, "XH540-V150", X),
    model(1160, "2XC430-W250", 0),
    model(1170, "XW540-T260", X),
    model(1180, "XW540-T140", X),
    model(1190, "XL330-M077", 1000),
    model(1200, "XL330-M288", 1000),
    model(1210, "XC330-T181", 1000),
    model(1220, "XC330-T288", 1000),
    model(1230, "XC330-M181", 1000),
    model(1240, "XC330-M288", 1000),
    model(1270, "XW430-T333", X),
    model(1280, "XW430-T200", X),
    model(1310, "XW540-H260", X),
];

/// The model of this number, or the list of those that there are.
pub(crate) fn find(number: u16) -> Result<&'static Model, String> {
    MODELS.iter().find(|model| model.number == number).ok_or_else(|| {
        let known: Vec<_> = MODELS.iter().map(|model| format!("{} {}", model.number, model.name)).collect();
        format!("one of {}", known.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_one_model_or_none() {
        assert!(MODELS.windows(2).all(|pair| pair[0].number < pair[1].number), "in order, each once");
        assert_eq!(find(1190).map(|model| (model.name, model.current_ua)), Ok(("XL330-M077", 1000)));
        let expected = find(350).expect_err("XL-320 has other registers");
        assert!(expected.contains("1020 XM430-W350") && expected.contains("1280 XW430-T200"), "{expected}");
    }
}
