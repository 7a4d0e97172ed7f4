//! Words that the glossary replaces: in names of the code, and in its messages.

use std::path::Path;

const REPLACED: [&str; 33] = [
    "told",
    "nobody",
    "stranger",
    "strangers",
    "wearer",
    "ails",
    "seat",
    "seats",
    "seated",
    "aside",
    "tie",
    "tied",
    "lane",
    "lanes",
    "inlet",
    "tap",
    "fed",
    "taken",
    "kept",
    "said",
    "heard",
    "outlook",
    "papers",
    "flaws",
    "wishes",
    "greatest",
    "anew",
    "obey",
    "promised",
    "promise",
    "whose",
    "way",
    "beside",
];

/// Names of other wings, of flags and of keys in rig.toml.
const OF_OTHERS: [&str; 3] = ["listen_aside", "aside_port", "aside_to"];

/// `FILE: WORD` of each, in a file's code.
pub fn replaced(file: &Path, text: &str) -> Vec<String> {
    let (code, strings) = parted(text);
    let name = |c: char| c.is_alphanumeric() || c == '_';
    let names = code.split(|c| !name(c)).filter(|name| !OF_OTHERS.contains(name));
    let of_names = names.filter(|name| words(name).iter().any(|word| REPLACED.contains(&word.as_str())));
    // a word with a dash or an underscore is a key or a flag
    let of_strings = strings.iter().flat_map(|text| text.split(|c: char| !name(c) && c != '-'));
    let of_strings = of_strings.filter(|word| REPLACED.contains(&word.to_lowercase().as_str()));
    of_names.chain(of_strings).map(|word| format!("{}: {word}", file.display())).collect()
}

/// The parts of `a_name`, `AName` and `A_NAME`.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = '_';
    for c in name.chars() {
        if c == '_' || c.is_uppercase() && before.is_lowercase() {
            words.push(String::new());
        }
        if let (true, Some(last)) = (c != '_', words.last_mut()) {
            last.extend(c.to_lowercase());
        }
        before = c;
    }
    words
}

/// Code without comments and strings; the strings that are sentences.
fn parted(text: &str) -> (String, Vec<String>) {
    let (mut code, mut strings) = (String::new(), Vec::new());
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '/' if chars.peek() == Some(&'/') => while chars.next_if(|c| *c != '\n').is_some() {},
            '\'' => {
                // a quotation mark or a backslash as a character
                code.push(' ');
                let rest: Vec<char> = chars.clone().take(3).collect();
                let length = if matches!(rest[..], ['\\', _, '\'']) {
                    3
                } else if matches!(rest[..], ['"', '\'', ..]) {
                    2
                } else {
                    0
                };
                for _ in 0..length {
                    chars.next();
                }
            }
            '"' => {
                let mut string = String::new();
                while let Some(c) = chars.next_if(|c| *c != '"') {
                    if c == '\\' {
                        chars.next();
                    } else {
                        string.push(c);
                    }
                }
                chars.next();
                code.push(' ');
                strings.extend(string.contains(' ').then_some(string));
            }
            c => code.push(c),
        }
    }
    (code, strings)
}
