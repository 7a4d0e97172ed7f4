//! Progress and notices while a recording is read.

use crate::simulate::Progress;

/// Is called as a long part of the work advances, and dropped at its end.
pub(crate) type Advance = Box<dyn Fn(Progress)>;
/// Is called with the position in a file, and dropped at the end of the pass.
pub(crate) type ShowPosition = Box<dyn FnMut(u64)>;

/// What is called while a recording is read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observer {
    /// A long part of the work begins.
    pub stage: fn(&str) -> Advance,
    /// A pass over a file of so many bytes begins.
    pub reading: fn(u64) -> ShowPosition,
    /// Something that the user may not expect was done.
    pub notice: fn(&str),
}

impl Default for Observer {
    fn default() -> Self {
        Self { stage: |_| Box::new(|_| {}), reading: |_| Box::new(|_| {}), notice: |_| {} }
    }
}
