//! Coverage as a point cloud.

use super::Coverage;
use crate::world::local_origin::LocalOrigin;

impl Coverage {
    /// A PLY cloud of the centres of the voxels seen, in the frame of the files, with one bit per sensor.
    pub(crate) fn ply(&self, sensor_names: &[&str], origin: LocalOrigin) -> Vec<u8> {
        let grid = self.grid();
        let cells = self.union_cells();
        let [x, y, z] = origin.world(grid.origin_m).to_array();
        let [nx, ny, nz] = grid.cells;
        let mut text = format!(
            "ply\nformat binary_little_endian 1.0\n\
         comment outrigger coverage, world frame, metres\n\
         comment grid origin {x} {y} {z} voxel {} cells {nx} {ny} {nz}\n",
            grid.voxel_m
        );
        for (bit, name) in sensor_names.iter().enumerate() {
            let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            text += &format!("comment sensors bit {bit}: {name}\n");
        }
        text += &format!(
            "element vertex {}\nproperty double x\nproperty double y\nproperty double z\nproperty uint sensors\nend_header\n",
            cells.len()
        );
        let mut bytes = text.into_bytes();
        for cell in cells {
            for value in origin.world(grid.centre_m(cell)).to_array() {
                bytes.extend(value.to_le_bytes());
            }
            let seen_by = |mask, sensor| mask | u32::from(self.contains(sensor, cell)) << sensor;
            bytes.extend((0..sensor_names.len()).fold(0u32, seen_by).to_le_bytes());
        }
        bytes
    }
}
