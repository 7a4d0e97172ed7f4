//! A servo rig behind a pty: the real state machine on a simulated plant, with faults on demand.
