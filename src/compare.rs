//! Predicted against recorded coverage.
