//! rosbag2's SQLite files, read in the order in which they were written.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::path::Path;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags};
use tempfile::TempDir;

use super::unpack::MOST_MESSAGE_BYTES;
use super::{BagError, BagFile, Container, Encoding, Losses, Topic};

pub(super) struct Db3 {
    connection: Connection,
    name: String,
    topics: Vec<Topic>,
    /// Number of each topic by its id in the file.
    ids: Vec<(i64, usize)>,
    /// Ids of the topics that are needed, where not all are.
    wanted: Option<Vec<i64>>,
    /// The message that was read last.
    row: i64,
    /// Those that were read and not yet handed out.
    ahead: VecDeque<Row>,
    message: Vec<u8>,
    bytes_read: u64,
    losses: Losses,
    is_ended: bool,
    /// Where it was copied to with the log that belongs to it.
    _copy: Option<TempDir>,
}

struct Row {
    id: i64,
    topic: i64,
    time_ns: u64,
    data: Vec<u8>,
}

/// Messages that one query gives at most; and it ends behind so many bytes.
const MESSAGES_AT_ONCE: usize = 64;
const BYTES_AT_ONCE: usize = 1 << 20;

impl Db3 {
    pub fn open(bag_file: &BagFile) -> Result<Self, BagError> {
        let BagFile { path, name } = bag_file;
        let copy = with_log(path).map_err(|source| bag_file.io("its log cannot be read", source))?;
        let flags = OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
        let opened = match &copy {
            Some(folder) => {
                let at = folder.path().join(COPY);
                Connection::open_with_flags(uri(&at, ""), flags | OpenFlags::SQLITE_OPEN_READ_WRITE)
            }
            // nothing is written next to a recording
            None => Connection::open_with_flags(
                uri(path, "?immutable=1"),
                flags | OpenFlags::SQLITE_OPEN_READ_ONLY,
            ),
        };
        let connection = opened.map_err(|error| sql(name, &error))?;
        let mut bag = Self {
            connection,
            name: name.clone(),
            topics: Vec::new(),
            ids: Vec::new(),
            wanted: None,
            row: i64::MIN,
            ahead: VecDeque::new(),
            message: Vec::new(),
            bytes_read: 0,
            losses: Losses::default(),
            is_ended: false,
            _copy: copy,
        };
        bag.read_topics().map_err(|error| sql(&bag.name, &error))?;
        if bag.topics.is_empty() {
            bag.losses.push(format!("{}: the file lists no topic", bag.name));
        }
        Ok(bag)
    }

    fn read_topics(&mut self) -> rusqlite::Result<()> {
        self.connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA mmap_size = 0;")?;
        let mut statement =
            self.connection.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let text = |column: usize| {
                Ok::<_, rusqlite::Error>(row.get_ref(column)?.as_str().unwrap_or("").to_owned())
            };
            let encoding = if text(3)? == "cdr" { Encoding::Cdr } else { Encoding::Other };
            self.ids.push((row.get(0)?, self.topics.len()));
            self.topics.push(Topic::new(text(1)?, &text(2)?, encoding));
        }
        Ok(())
    }

    /// Reads some of the next messages.
    fn read_more(&mut self) -> rusqlite::Result<()> {
        let mut query = String::from("SELECT id, topic_id, timestamp, data FROM messages WHERE id > ?1");
        if let Some(wanted) = &self.wanted {
            let ids: Vec<String> = wanted.iter().map(ToString::to_string).collect();
            let _ = write!(query, " AND topic_id IN ({})", ids.join(", "));
        }
        let _ = write!(query, " ORDER BY id LIMIT {MESSAGES_AT_ONCE}");
        let mut statement = self.connection.prepare(&query)?;
        let mut rows = statement.query([self.row])?;
        let mut bytes = 0;
        while bytes < BYTES_AT_ONCE
            && let Some(row) = rows.next()?
        {
            self.row = row.get(0)?;
            let (topic, time_ns): (i64, i64) = (row.get(1)?, row.get(2)?);
            let data = match row.get_ref(3)? {
                ValueRef::Blob(data) if data.len() <= MOST_MESSAGE_BYTES => data.to_vec(),
                _ => Vec::new(), // which is no message of any type
            };
            bytes += data.len();
            self.ahead.push_back(Row { id: self.row, topic, time_ns: time_ns.cast_unsigned(), data });
        }
        Ok(())
    }
}

impl Container for Db3 {
    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn advance(&mut self) -> Result<Option<(usize, u64)>, BagError> {
        loop {
            while let Some(Row { id, topic, time_ns, data }) = self.ahead.pop_front() {
                self.bytes_read += data.len() as u64;
                if let Some((_, number)) = self.ids.iter().find(|(known, _)| *known == topic) {
                    self.message = data;
                    return Ok(Some((*number, time_ns)));
                }
                let name = &self.name;
                self.losses
                    .push(format!("{name}: message {id} is of topic {topic}, which the file does not list"));
            }
            if self.is_ended {
                return Ok(None);
            }
            let outcome = self.read_more();
            self.is_ended = outcome.is_err() || self.ahead.is_empty();
            if let Err(error) = outcome {
                let behind =
                    if self.row == i64::MIN { "the start".into() } else { format!("message {}", self.row) };
                self.losses.push(format!("{}: reading stops behind {behind}: {error}", self.name));
            }
        }
    }

    fn data(&self) -> &[u8] {
        &self.message
    }

    fn restrict(&mut self, is_wanted: &dyn Fn(&Topic) -> bool) -> bool {
        let wanted = self.ids.iter().filter(|(_, at)| is_wanted(&self.topics[*at]));
        let wanted: Vec<i64> = wanted.map(|(id, _)| *id).collect();
        self.is_ended |= wanted.is_empty();
        self.wanted = Some(wanted);
        true
    }

    fn position(&self) -> u64 {
        self.bytes_read
    }

    fn losses(&self) -> &Losses {
        &self.losses
    }
}

fn sql(name: &str, error: &rusqlite::Error) -> BagError {
    BagError::Unsupported {
        name: name.to_owned(),
        found: format!("no ROS 2 bag that can be read ({error})"),
        instead: "expected an SQLite file with the tables topics and messages, whole; `sqlite3 FILE .recover` may mend one",
    }
}

/// Name of a copy.
const COPY: &str = "bag.db3";

/// A copy of a file with what is not yet in it: a write-ahead log, or the journal of a killed recorder.
fn with_log(path: &Path) -> std::io::Result<Option<TempDir>> {
    let neighbour = |suffix: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        std::path::PathBuf::from(name)
    };
    let is_there = |suffix: &&str| std::fs::metadata(neighbour(suffix)).is_ok_and(|file| file.len() > 0);
    let logs: Vec<&str> = ["-wal", "-journal"].into_iter().filter(is_there).collect();
    if logs.is_empty() {
        return Ok(None);
    }
    let folder = TempDir::new()?;
    std::fs::copy(path, folder.path().join(COPY))?;
    for suffix in logs {
        std::fs::copy(neighbour(suffix), folder.path().join(format!("{COPY}{suffix}")))?;
    }
    Ok(Some(folder))
}

/// A path as SQLite wants it.
fn uri(path: &Path, options: &str) -> std::path::PathBuf {
    use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut text = b"file:".to_vec();
    for byte in absolute.as_os_str().as_bytes() {
        match byte {
            b'?' | b'#' | b'%' => text.extend(format!("%{byte:02x}").bytes()),
            byte => text.push(*byte),
        }
    }
    text.extend(options.bytes());
    std::ffi::OsString::from_vec(text).into()
}
