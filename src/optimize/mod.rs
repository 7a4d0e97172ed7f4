//! Ask/tell search methods.
