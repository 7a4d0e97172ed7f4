//! Why a request was not carried out: a status code and words.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use crate::daemon::ProposalError;
use crate::daemon::recorder::RecorderError;
use crate::daemon::rig::RigCommandError;
use crate::drive::RigError;

/// A refusal, as `{"error": "..."}`.
#[derive(Debug)]
pub(super) struct Refusal {
    code: StatusCode,
    words: String,
}

impl Refusal {
    pub(crate) fn new(code: StatusCode, words: impl Into<String>) -> Self {
        Self { code, words: words.into() }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.code, Json(serde_json::json!({ "error": self.words }))).into_response()
    }
}

impl From<RecorderError> for Refusal {
    fn from(error: RecorderError) -> Self {
        let code = match error {
            RecorderError::AlreadyRecording(_) | RecorderError::NotRecording => StatusCode::CONFLICT,
            RecorderError::DiskFull { .. } => StatusCode::INSUFFICIENT_STORAGE,
            RecorderError::Session(_) | RecorderError::Stalled => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self::new(code, error.to_string())
    }
}

impl From<RigCommandError> for Refusal {
    fn from(error: RigCommandError) -> Self {
        let code = match error {
            RigCommandError::NoRig | RigCommandError::NoMount => StatusCode::NOT_FOUND,
            RigCommandError::NotConnected(_) => StatusCode::SERVICE_UNAVAILABLE,
            RigCommandError::Rig(RigError::AxisCount { .. } | RigError::NoAngle { .. }) => {
                StatusCode::BAD_REQUEST
            }
            RigCommandError::Busy(_)
            | RigCommandError::NotArmed
            | RigCommandError::Latched(_)
            | RigCommandError::Rig(_) => StatusCode::CONFLICT,
        };
        Self::new(code, error.to_string())
    }
}

impl From<ProposalError> for Refusal {
    fn from(error: ProposalError) -> Self {
        let code = match error {
            ProposalError::Rig(error) => return error.into(),
            ProposalError::NotSplit(_) | ProposalError::Thread(_) => StatusCode::INTERNAL_SERVER_ERROR,
            _ => StatusCode::CONFLICT,
        };
        Self::new(code, error.to_string())
    }
}
