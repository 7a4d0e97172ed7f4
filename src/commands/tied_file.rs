//! A file, or a file with what tells whose it is before it: `FILE`, `192.168.1.10=FILE`, `:7502=FILE`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use sensors::router::Tie;

/// A file of a sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TiedFile {
    /// Which sensor's.
    pub tie: Option<Tie>,
    /// Where it is.
    pub path: PathBuf,
}

impl TiedFile {
    /// The same text with the file as seen from a folder.
    pub fn text_in(text: &str, folder: &Path) -> OsString {
        let Self { tie, path } = OsString::from(text).into();
        let mut seen = tie.map_or_else(OsString::new, |tie| format!("{tie}=").into());
        seen.push(folder.join(path));
        seen
    }
}

impl From<OsString> for TiedFile {
    fn from(text: OsString) -> Self {
        let split = text.to_str().and_then(|text| text.split_once('='));
        let tied = split.and_then(|(tie, path)| Some((Tie::from_text(tie)?, path)));
        match tied {
            Some((tie, path)) => Self { tie: Some(tie), path: path.into() },
            // a name may hold an equals sign, too
            None => Self { tie: None, path: text.into() },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_with_and_without_their_sensor() {
        let read = |text: &str| {
            let TiedFile { tie, path } = OsString::from(text).into();
            (tie.map(|tie| tie.to_string()), path.display().to_string())
        };
        let sender = |tie: &str, path: &str| (Some(tie.to_owned()), path.to_owned());
        assert_eq!(read("front.json"), (None, "front.json".into()));
        assert_eq!(read("192.168.1.10=front.json"), sender("192.168.1.10", "front.json"));
        assert_eq!(read("fe80::1=a=b.json"), sender("fe80::1", "a=b.json"));
        assert_eq!(read(":7502=front.json"), sender(":7502", "front.json"));
        assert_eq!(read("a=b.json"), (None, "a=b.json".into()));
        assert_eq!(TiedFile::text_in(":7502=a.json", Path::new("rig")), ":7502=rig/a.json");
        assert_eq!(TiedFile::text_in("a.json", Path::new("rig")), "rig/a.json");
    }
}
