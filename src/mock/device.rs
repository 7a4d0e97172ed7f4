//! Either kind of mock servos behind a pty.

use std::path::Path;

use super::bus_servos::MockServos;
use super::rig::{MockFault, MockRig};

pub(crate) enum Device {
    Rig(MockRig),
    Servos(MockServos),
}

impl Device {
    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Rig(rig) => rig.path(),
            Self::Servos(servos) => servos.path(),
        }
    }

    pub(crate) fn is_running(&self) -> bool {
        match self {
            Self::Rig(rig) => rig.is_running(),
            Self::Servos(_) => true,
        }
    }

    pub(crate) fn inject(&self, fault: MockFault) {
        match (self, fault) {
            (Self::Rig(rig), fault) => rig.inject(fault),
            (Self::Servos(servos), MockFault::Axis(axis, fault)) => servos.inject(axis, fault),
            (Self::Servos(_), _) => {} // refused before anything started
        }
    }
}
