//! Score: the terms of J, each with its own number.
