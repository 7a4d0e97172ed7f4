//! Point files: PCD, PLY, LAS/LAZ, E57, MCAP, CSV.
