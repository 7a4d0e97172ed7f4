//! Questions to a sensor's web server, bounded in size and time.

use std::time::Duration;

use serde_json::Value;

/// Longest answer that is read: metadata of a 128-beam sensor has 60 kB.
pub const LONGEST_BYTES: u64 = 4 << 20;
/// How much of an answer is shown in an error.
const SHOWN_CHARS: usize = 80;

/// What goes wrong between this program and a sensor's web server.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// The address is none.
    #[error("{address:?}: expected HOST or HOST:PORT")]
    Address {
        /// As given.
        address: String,
    },
    /// No answer.
    #[error("{}: {reason}: is the sensor powered, on this network, and is the address right?", plain(url))]
    Unreachable {
        /// What was asked for.
        url: String,
        /// The system's reason.
        reason: String,
    },
    /// It answers with an error.
    #[error("{}: answered status {status}{}", plain(url), answered(*status, body))]
    Status {
        /// What was asked for.
        url: String,
        /// HTTP status.
        status: u16,
        /// Body of the answer.
        body: String,
    },
    /// The answer broke off, took too long or has no end.
    #[error("{}: the answer could not be read whole: {reason}", plain(url))]
    Broken {
        /// What was asked for.
        url: String,
        /// What happened.
        reason: String,
    },
    /// The answer is no JSON, or not the JSON it should be.
    #[error("{}: expected {expected}, found{}", plain(url), shown(body))]
    Unexpected {
        /// What was asked for.
        url: String,
        /// What should have come.
        expected: &'static str,
        /// What came.
        body: String,
    },
    /// It is no sensor that is known here.
    #[error("{address}: neither an Ouster nor a Velodyne answers there ({reason})")]
    Unknown {
        /// Who was asked.
        address: String,
        /// What was tried.
        reason: String,
    },
    /// A setting that this kind of sensor does not have.
    #[error("{address}: {reason}")]
    Setting {
        /// Who was to be set.
        address: String,
        /// What is wrong with it.
        reason: String,
    },
    /// It does not run again.
    #[error("{address}: not running again within {within:?}; it says {status}")]
    NotReady {
        /// Who was set.
        address: String,
        /// How long was waited.
        within: Duration,
        /// Its last status.
        status: String,
    },
}

/// An address without what was asked there in detail.
fn plain(url: &str) -> &str {
    url.split_once('?').map_or(url, |(plain, _)| plain)
}

/// The begin of an answer, for an error.
fn shown(body: &str) -> String {
    let line: String = body.chars().filter(|c| !c.is_control()).take(SHOWN_CHARS).collect();
    if line.is_empty() { " nothing".to_owned() } else { format!(" `{line}`") }
}

/// What an answer that is an error says: its message, where it is in JSON as sensors write it.
fn answered(status: u16, body: &str) -> String {
    let document: Value = serde_json::from_str(body).unwrap_or_default();
    let message = ["/error/msg", "/error/description", "/error", "/msg"]
        .into_iter()
        .find_map(|path| document.pointer(path).and_then(Value::as_str));
    match (message, status) {
        (Some(message), _) => format!(": {message}"),
        (None, 300..400) => ": it sends us elsewhere, which no sensor does".to_owned(),
        (None, 503) => {
            format!(", which a sensor that starts does (it says{}): ask again in half a minute", shown(body))
        }
        (None, _) if body.is_empty() => " and nothing else".to_owned(),
        (None, _) => format!(" and{}", shown(body)),
    }
}

/// A sensor's web server.
#[derive(Clone, Debug)]
pub struct Http {
    agent: ureq::Agent,
    address: String,
}

impl Http {
    /// The server at `HOST` or `HOST:PORT`.
    pub fn new(address: &str) -> Result<Self, SetupError> {
        Self::with_patience(address, Duration::from_secs(3), Duration::from_secs(10))
    }

    /// The same, with times for the connection and for a whole answer.
    pub fn with_patience(address: &str, connect: Duration, whole: Duration) -> Result<Self, SetupError> {
        let address = address.strip_prefix("http://").unwrap_or(address).trim_end_matches('/');
        let plain = |c: char| c.is_ascii_alphanumeric() || ".-_:[]%".contains(c);
        if address.is_empty() || !address.chars().all(plain) {
            return Err(SetupError::Address { address: address.to_owned() });
        }
        let agent = ureq::Agent::config_builder()
            .timeout_connect(Some(connect))
            .timeout_global(Some(whole))
            .max_redirects(0) // a sensor has nowhere else to send us
            .max_redirects_will_error(false)
            .http_status_as_error(false)
            .proxy(None)
            .user_agent("outrigger")
            .build()
            .into();
        Ok(Self { agent, address: address.to_owned() })
    }

    /// Who is asked.
    pub(crate) fn address(&self) -> &str {
        &self.address
    }

    fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    /// Reads a document.
    pub(crate) fn get(&self, path: &str) -> Result<String, SetupError> {
        let url = self.url(path);
        let answer = self.agent.get(&url).call();
        whole(url, answer)
    }

    /// Reads a JSON document.
    pub(crate) fn get_json(&self, path: &str) -> Result<Value, SetupError> {
        let text = self.get(path)?;
        serde_json::from_str(&text).map_err(|_| SetupError::Unexpected {
            url: self.url(path),
            expected: "a JSON document",
            body: text,
        })
    }

    /// The same; nothing where the server has no such document.
    pub(crate) fn find_json(&self, path: &str) -> Result<Option<Value>, SetupError> {
        match self.get_json(path) {
            Ok(document) => Ok(Some(document)),
            Err(SetupError::Status { status: 400..=405 | 501, .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Sends a JSON document.
    pub(crate) fn post_json(&self, path: &str, document: &Value) -> Result<String, SetupError> {
        let url = self.url(path);
        let request = self.agent.post(&url).header("Content-Type", "application/json");
        whole(url, request.send(document.to_string()))
    }

    /// Sends a form.
    pub(crate) fn post_form(&self, path: &str, fields: &[(&str, String)]) -> Result<String, SetupError> {
        let url = self.url(path);
        let fields = fields.iter().map(|(name, value)| (*name, value.as_str()));
        whole(url.clone(), self.agent.post(&url).send_form(fields))
    }
}

fn whole(
    url: String,
    answer: Result<ureq::http::Response<ureq::Body>, ureq::Error>,
) -> Result<String, SetupError> {
    let mut response = match answer {
        Ok(response) => response,
        Err(error) => {
            let reason = error.to_string();
            return Err(match error {
                // before any byte came
                ureq::Error::Io(_)
                | ureq::Error::ConnectionFailed
                | ureq::Error::HostNotFound
                | ureq::Error::Timeout(ureq::Timeout::Connect | ureq::Timeout::Resolve) => {
                    SetupError::Unreachable { url, reason }
                }
                error => SetupError::Broken { url, reason: in_words(&error) },
            });
        }
    };
    let status = response.status().as_u16();
    let body = response.body_mut().with_config().limit(LONGEST_BYTES).lossy_utf8(true).read_to_string();
    match body {
        Ok(text) if (200..300).contains(&status) => Ok(text),
        Ok(body) => Err(SetupError::Status { url, status, body }),
        Err(error) => Err(SetupError::Broken { url, reason: in_words(&error) }),
    }
}

/// Why an answer broke off.
fn in_words(error: &ureq::Error) -> String {
    match error {
        ureq::Error::Timeout(_) => "it takes too long".to_owned(),
        ureq::Error::BodyExceedsLimit(limit) => format!("it is longer than {} MiB", limit >> 20),
        other => other.to_string(),
    }
}
