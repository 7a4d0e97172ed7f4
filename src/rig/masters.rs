//! Masters as typed.

use std::str::FromStr;

use super::MountDeg;

/// Masters as typed, with the model of each where it was named.
#[derive(Clone, Debug)]
pub(crate) struct Masters(Vec<(MountDeg, Option<String>)>);

impl FromStr for Masters {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut masters = Vec::new();
        for (index, part) in text.trim().trim_end_matches(';').split(';').enumerate() {
            let place = format!("master {} ({:?})", index + 1, part.trim());
            let mut fields: Vec<_> = part.split(',').map(str::trim).collect();
            let model = if fields.len() == 6 { fields.pop().map(str::to_owned) } else { None };
            let numbers = fields
                .iter()
                .map(|number| number.parse::<f64>().ok().filter(|value| value.is_finite()))
                .collect::<Option<Vec<_>>>()
                .ok_or_else(|| format!("{place}: every part must be a finite number"))?;
            let found = numbers.len();
            let numbers: [f64; 5] = numbers.try_into().map_err(|_| {
                format!("{place}: {found} numbers, expected x,y,z,pitch_deg,roll_deg[,model]")
            })?;
            masters.push((numbers.into(), model));
        }
        Ok(Self(masters))
    }
}

/// Masters with or without a model where the other was expected.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MastersError {
    #[error("master {number}: model {model} is not specified here")]
    ModelNamed { number: usize, model: String },
    #[error(
        "master {number}: end it with the model of its sensor, one of {known} (x,y,z,pitch_deg,roll_deg,model)"
    )]
    WhichModel { number: usize, known: String },
}

impl Masters {
    /// The masters where the sensors are specified elsewhere; none may name a model.
    pub(crate) fn without_models(&self) -> Result<Vec<MountDeg>, MastersError> {
        let placed = |(index, (mount, model)): (usize, &(MountDeg, Option<String>))| match model {
            Some(model) => Err(MastersError::ModelNamed { number: index + 1, model: model.clone() }),
            None => Ok(*mount),
        };
        self.0.iter().enumerate().map(placed).collect()
    }

    /// The masters where these are the models of the sensor types: of the only one, or of the one that is named.
    pub(crate) fn of(&self, models: &[&str]) -> Result<Vec<MountDeg>, MastersError> {
        let placed = |(index, (mount, model)): (usize, &(MountDeg, Option<String>))| {
            let known = |name: &String| models.iter().position(|model| model.eq_ignore_ascii_case(name));
            match (model.as_ref().map(known), models) {
                (None, [_]) => Ok(*mount),
                (Some(Some(sensor_type)), _) => Ok(MountDeg { sensor_type, ..*mount }),
                _ => Err(MastersError::WhichModel { number: index + 1, known: models.join(", ") }),
            }
        };
        self.0.iter().enumerate().map(placed).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masters_are_read_or_refused_by_name() {
        let masters = "0.1,-0.2,0,25,0; -0.1,0,0,-25,5;".parse::<Masters>().unwrap().0;
        assert_eq!(masters.len(), 2);
        assert_eq!(masters[1].0.pitch_deg, -25.0);
        for (bad, words) in [
            ("", "master 1"),
            ("1,2,3,4", "4 numbers"),
            ("0,0,0,NaN,0", "finite"),
            ("0,0,0,0,0;0,0,0,x,0", "master 2"),
            ("0,0,0,0,0;;0,0,0,0,0", "master 2"),
        ] {
            let error = bad.parse::<Masters>().unwrap_err();
            assert!(error.contains(words), "{bad}: {error}");
        }
        let named = "0,0,0,9,0, vlp-16;0,0,0,0,0,OS1-64".parse::<Masters>().unwrap();
        assert!(named.without_models().unwrap_err().to_string().contains("master 1"));
        let both = ["os1-64", "vlp-16"];
        let types: Vec<_> = named.of(&both).unwrap().iter().map(|master| master.sensor_type).collect();
        assert_eq!(types, [1, 0]);
        let alone = ["os1-64"];
        assert!(named.of(&alone).unwrap_err().to_string().contains("one of os1-64"));
        let unnamed = "0,0,0,9,0".parse::<Masters>().unwrap();
        assert_eq!(unnamed.of(&alone).unwrap().len(), 1);
        assert!(unnamed.of(&both).unwrap_err().to_string().contains("os1-64, vlp-16"));
    }
}
