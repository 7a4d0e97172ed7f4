//! What a rig's host and its microcontroller must agree on: the messages, the two link layers, and the one state
//! machine that both run.
#![no_std]
