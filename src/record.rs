//! The session folder: raw packets, servo reports, config; readable after a crash.
