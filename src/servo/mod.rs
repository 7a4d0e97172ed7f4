//! Links to a servo rig, drivers and the rig controller.
