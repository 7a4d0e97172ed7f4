//! A file, alone or behind a source filter: `FILE`, `192.168.1.10=FILE`, `:7502=FILE`,
//! `192.168.1.10:7502=FILE`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use sensors::router::{GivenModel, SourceFilter};
use sensors::velodyne::Product;

/// A file of a sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct AssignedFile {
    /// Which sensor's.
    pub source_filter: Option<SourceFilter>,
    pub path: PathBuf,
}

impl AssignedFile {
    /// Reads what was typed.
    pub(crate) fn read(text: OsString) -> Result<Self, String> {
        let split = text.to_str().and_then(|text| text.split_once('='));
        match split.and_then(|(source_filter, path)| Some((SourceFilter::from_text(source_filter)?, path))) {
            Some((_, "")) => Err("no file is named behind the equals sign".into()),
            Some((source_filter, path)) => {
                Ok(Self { source_filter: Some(source_filter?), path: path.into() })
            }
            // a name may hold an equals sign, too
            None => Ok(Self { source_filter: None, path: text.into() }),
        }
    }

    /// The name before the equals sign of `NAME=FILE`, and the file behind it; none where there is a file of the whole name.
    pub(crate) fn of_name(&self) -> Option<(String, PathBuf)> {
        let text = self.path.to_str().filter(|_| !self.path.exists())?;
        let (before, file) = text.split_once('=')?;
        let (folder, name) = before.rsplit_once('/').map_or(("", before), |(folder, name)| (folder, name));
        (!name.is_empty()).then(|| (name.to_owned(), Path::new(folder).join(file)))
    }

    /// The same text with the file as seen from a folder; what is wrong stays as it is, to be reported.
    pub(crate) fn text_in(text: &str, folder: &Path) -> OsString {
        let Ok(Self { source_filter, path }) = Self::read(text.into()) else { return text.into() };
        let mut seen =
            source_filter.map_or_else(OsString::new, |source_filter| format!("{source_filter}=").into());
        seen.push(folder.join(path));
        seen
    }
}

/// The product of a Velodyne with or without what tells which one is meant: `MODEL`, `192.168.1.201=MODEL`, `:2368=MODEL`.
pub(crate) fn assigned_model(text: &str) -> Result<GivenModel, String> {
    let (source_filter, name) = match text.split_once('=') {
        None => (None, text),
        Some((source_filter, name)) => {
            let unknown =
                || format!("{source_filter}: no address and no port, expected ADDRESS=MODEL or :PORT=MODEL");
            (Some(SourceFilter::from_text(source_filter).ok_or_else(unknown)??), name)
        }
    };
    let product = Product::from_name(name).ok_or_else(|| {
        let known: Vec<&str> = Product::ALL.into_iter().map(Product::name).collect();
        format!("{name}: no Velodyne model, expected one of {}", known.join(", "))
    })?;
    Ok(GivenModel { source_filter, product })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_with_and_without_their_sensor() {
        let product = Product::Hdl32e;
        assert_eq!(assigned_model("HDL-32E"), Ok(GivenModel { source_filter: None, product }));
        assert_eq!(
            assigned_model(":2368=hdl-32e"),
            Ok(GivenModel { source_filter: Some(SourceFilter::Port(2368)), product })
        );
        for (wrong, words) in [("os1-64", "no Velodyne"), ("x=hdl-32e", "no address"), (":0=hdl-32e", "1 to")]
        {
            let error = assigned_model(wrong).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn files_with_and_without_their_sensor() {
        let read = |text: &str| {
            let AssignedFile { source_filter, path } = AssignedFile::read(text.into()).unwrap();
            (source_filter.map(|source_filter| source_filter.to_string()), path.display().to_string())
        };
        let sender = |source_filter: &str, path: &str| (Some(source_filter.to_owned()), path.to_owned());
        assert_eq!(read("front.json"), (None, "front.json".into()));
        assert_eq!(read("192.168.1.10=front.json"), sender("192.168.1.10", "front.json"));
        assert_eq!(read("fe80::1=a=b.json"), sender("fe80::1", "a=b.json"));
        assert_eq!(read(":7502=front.json"), sender(":7502", "front.json"));
        assert_eq!(read("[fe80::1]=a.json"), sender("fe80::1", "a.json"));
        assert_eq!(read("::1=a.json"), sender("::1", "a.json"));
        assert_eq!(read("192.168.1.10:7502=a.json"), sender("192.168.1.10:7502", "a.json"));
        assert_eq!(read("[fe80::1]:7502=a.json"), sender("[fe80::1]:7502", "a.json"));
        for no_source_filter in ["a=b.json", ":a=b.json", "a:1=b.json", "fe80::1]=b.json", ":=b.json"] {
            assert_eq!(read(no_source_filter), (None, no_source_filter.into()));
        }
        for wrong in [":0=a.json", ":99999=a.json", "192.168.1.10:0=a.json", "[::1]:65536=a.json"] {
            let error = AssignedFile::read(wrong.into()).unwrap_err();
            assert!(error.contains("expected 1 to 65535"), "{error}");
        }
        assert_eq!(AssignedFile::text_in(":7502=a.json", Path::new("rig")), ":7502=rig/a.json");
        assert_eq!(AssignedFile::text_in("a.json", Path::new("rig")), "rig/a.json");
    }
}
