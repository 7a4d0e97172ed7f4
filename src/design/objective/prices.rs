//! Prices of sensors.

use std::str::FromStr;

use super::Weights;
use super::published::model_of;

/// What sensors cost: `PRICE`, or `MODEL=PRICE,MODEL=PRICE`.
#[derive(Clone, Debug)]
pub(crate) enum Prices {
    /// Of any sensor.
    Any(f64),
    /// By model.
    ByModel(Vec<(String, f64)>),
}

impl Default for Prices {
    fn default() -> Self {
        Self::Any(Weights::default().sensor_cost)
    }
}

impl std::fmt::Display for Prices {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Any(price) => write!(f, "{price}"),
            Self::ByModel(prices) => {
                let each: Vec<_> = prices.iter().map(|(model, price)| format!("{model}={price}")).collect();
                f.write_str(&each.join(","))
            }
        }
    }
}

/// Highest price: beyond it J loses the voxels that it counts.
const HIGHEST: f64 = 1e12;

impl FromStr for Prices {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.trim().parse().ok().filter(|price: &f64| price.abs() <= HIGHEST);
        if let Some(price) = number(text) {
            return Ok(Self::Any(price));
        }
        let priced = |part: &str| {
            let (model, price) = part.split_once('=')?;
            Some((model.trim().to_owned(), number(price)?))
        };
        let prices: Option<Vec<_>> = text.split(',').map(priced).collect();
        let prices = prices.ok_or("give a number from -1e12 to 1e12, or MODEL=NUMBER,MODEL=NUMBER")?;
        match prices.iter().enumerate().find(|(at, (model, _))| prices[..*at].iter().any(|p| p.0 == *model)) {
            Some((_, (model, _))) => Err(format!("{model} has two prices")),
            None => Ok(Self::ByModel(prices)),
        }
    }
}

/// Prices that do not fit the sensor types of an experiment.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PriceError {
    #[error("--lambda has a price for {model}, but the rig's sensors are {models}")]
    NoSuchSensor { model: String, models: String },
    #[error("--lambda has no price for {model}: give one for each of {models}")]
    NoPrice { model: &'static str, models: String },
}

impl Prices {
    /// The price of a sensor of each of these models.
    pub(crate) fn of(&self, models: &[&'static str]) -> Result<Vec<f64>, PriceError> {
        let prices = match self {
            Self::Any(price) => return Ok(vec![*price; models.len()]),
            Self::ByModel(prices) => prices,
        };
        if let Some((model, _)) = prices.iter().find(|(model, _)| !models.contains(&model.as_str())) {
            return Err(PriceError::NoSuchSensor { model: model.clone(), models: models.join(", ") });
        }
        let price = |model: &&'static str| {
            let priced = prices.iter().find(|(priced, _)| priced == model).map(|(_, price)| *price);
            priced.ok_or_else(|| PriceError::NoPrice { model, models: models.join(", ") })
        };
        models.iter().map(price).collect()
    }
}

/// The price of a sensor of each of these presets, by model in alphabetical order.
pub(crate) fn prices_by_model(presets: &str, lambda: &[f64]) -> Vec<(String, f64)> {
    let models = presets.split(',').filter_map(|name| model_of(name.trim())).map(str::to_owned);
    let mut prices: Vec<_> = models.zip(lambda.iter().copied()).collect();
    prices.sort_by(|a, b| a.0.cmp(&b.0));
    prices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_price_for_all_or_one_for_each() {
        let (both, alone) = (&["os1-64", "vlp-16"][..], &["os1-64"][..]);
        let of = |text: &str, models| text.parse::<Prices>().map(|prices| prices.of(models));
        assert_eq!(of("500", both).unwrap().unwrap(), [500.0, 500.0]);
        assert_eq!(of("vlp-16=800, os1-64=2e3", both).unwrap().unwrap(), [2000.0, 800.0]);
        assert_eq!(of("os1-64=-1", alone).unwrap().unwrap(), [-1.0]);
        for (text, models, words) in [
            ("os1-64=2000", both, "no price for vlp-16"),
            ("os1-64=2000,vlp-16=1", alone, "a price for vlp-16"),
        ] {
            let error = of(text, models).unwrap().unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
        for (text, words) in [
            ("NaN", "from -1e12 to 1e12"),
            ("os1-64=x", "MODEL=NUMBER"),
            ("vlp-16=1,vlp-16=2", "two prices"),
            ("", "from -1e12 to 1e12"),
        ] {
            let error = text.parse::<Prices>().unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
        assert_eq!("vlp-16=800,os1-64=2e3".parse::<Prices>().unwrap().to_string(), "vlp-16=800,os1-64=2000");
        assert_eq!(Prices::default().to_string(), "2000");
    }
}
