//! Two questions as JSON: what was asked when a file was written, and what is asked now.

use serde_json::Value;

/// One place where two questions differ.
pub struct Difference {
    /// Its JSON pointer (RFC 6901).
    pub place: String,
    /// What was asked there; "none" for nothing.
    pub then: String,
    /// What is asked now.
    pub now: String,
}

/// The first place where two questions differ: of `foremost`, JSON pointers, or else of all places, those of `then` before
/// those that only `now` has.
pub(crate) fn first_difference(then: &Value, now: &Value, foremost: &[&str]) -> Option<Difference> {
    let mut places: Vec<String> = foremost.iter().map(|place| (*place).to_owned()).collect();
    leaves(then, "", &mut places);
    leaves(now, "", &mut places);
    let place = places.into_iter().find(|place| then.pointer(place) != now.pointer(place))?;
    let value = |question: &Value| match question.pointer(&place) {
        None | Some(Value::Null) => "none".to_owned(),
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
    };
    Some(Difference { then: value(then), now: value(now), place })
}

/// Pointers to all that is no object.
fn leaves(value: &Value, place: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            fields.iter().for_each(|(name, value)| leaves(value, &format!("{place}/{name}"), found));
        }
        _ => found.push(place.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_first_difference_is_named_with_both_values() {
        let then = json!({"a": {"b": 1, "c": "words"}, "d": null});
        let found = |now: &Value, foremost: &[&str]| {
            first_difference(&then, now, foremost).map(|found| (found.place, found.then, found.now))
        };
        let words = |place: &str, then: &str, now: &str| Some((place.into(), then.into(), now.into()));
        assert_eq!(found(&then, &["/nowhere"]), None);
        let two = json!({"a": {"b": 2, "c": "others"}, "d": null});
        assert_eq!(found(&two, &[]), words("/a/b", "1", "2"));
        assert_eq!(found(&two, &["/a/c"]), words("/a/c", "words", "others"));
        // a value in place of none, a place that only one of them has, and an object in place of a value
        assert_eq!(found(&json!({"a": {"b": 1, "c": "words"}, "d": [3]}), &[]), words("/d", "none", "[3]"));
        assert_eq!(
            found(&json!({"a": {"b": 1, "c": "words"}, "d": null, "e": true}), &[]),
            words("/e", "none", "true")
        );
        assert_eq!(
            found(&json!({"a": {"b": {"f": 1}, "c": "words"}, "d": null}), &[]),
            words("/a/b", "1", "{\"f\":1}")
        );
    }
}
