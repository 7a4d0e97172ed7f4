//! What is stored of each view of a voxel, 16 to a block, and where a voxel's blocks lie.

use super::numbering::Numbering;

/// Records of a block.
pub(super) const WIDTH: usize = 16;

/// Views of one voxel side by side: where its visible part lies in the frame of the body, in steps of the layer, and how wide
/// it looks there times its distance, in steps of its own. A width of 0 is no record.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Block {
    pub x: [i16; WIDTH],
    pub y: [i16; WIDTH],
    pub z: [i16; WIDTH],
    pub width: [u16; WIDTH],
}

impl Block {
    const EMPTY: Self = Self { x: [0; WIDTH], y: [0; WIDTH], z: [0; WIDTH], width: [0; WIDTH] };
}

/// One record before it is packed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record {
    /// Number of the voxel in the grid, of the list once it is made.
    pub cell: u32,
    /// In the frame of the body, m.
    pub at_m: [f32; 3],
    /// Square root of the solid angle times the distance, m.
    pub width_m: f32,
}

/// The records of one height.
pub(super) struct Layer {
    /// First block of each voxel, and the end.
    pub starts: Vec<u32>,
    pub blocks: Vec<Block>,
    /// Edge of a step of a position, m.
    pub step_m: f32,
    /// Edge of a step of a width, m.
    pub width_step_m: f32,
}

impl Layer {
    /// Packs the records of views, their voxels numbered in a list; the widest first, so that most searches end with them.
    pub(crate) fn pack(views: Vec<Vec<Record>>, numbering: &Numbering) -> Self {
        let voxels = numbering.count();
        let numbered = |record: &Record| Record { cell: numbering.of(record.cell), ..*record };
        let records = views.iter().flatten().map(numbered);
        let max = |value: fn(Record) -> f32| records.clone().map(value).fold(1e-3_f32, f32::max);
        let reach_m = max(|record| record.at_m.iter().fold(0.0, |most, value| value.abs().max(most)));
        let step_m = reach_m / f32::from(i16::MAX);
        let width_step_m = max(|record| record.width_m) / f32::from(u16::MAX);
        let by_voxel = by_voxel(records, voxels);
        drop(views); // before the blocks take their memory
        let blocks = by_voxel.chunk_by(is_same_voxel).map(|own| own.len().div_ceil(WIDTH)).sum();
        let mut layer = Self {
            starts: Vec::with_capacity(voxels + 1),
            blocks: Vec::with_capacity(blocks),
            step_m,
            width_step_m,
        };
        let mut rest = by_voxel.as_slice();
        for voxel in 0..voxels as u32 {
            layer.starts.push(layer.blocks.len() as u32);
            let count = rest.iter().take_while(|record| record.cell == voxel).count();
            let (own, others) = rest.split_at(count);
            rest = others;
            for records in own.chunks(WIDTH) {
                let mut block = Block::EMPTY;
                for (element, record) in records.iter().enumerate() {
                    let [x, y, z] = record.at_m;
                    let steps = |value: f32| (value / step_m).round() as i16;
                    (block.x[element], block.y[element], block.z[element]) = (steps(x), steps(y), steps(z));
                    block.width[element] = (record.width_m / width_step_m).round().max(1.0) as u16;
                }
                layer.blocks.push(block);
            }
        }
        layer.starts.push(layer.blocks.len() as u32);
        layer
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        std::mem::size_of_val(&self.blocks[..]) + std::mem::size_of_val(&self.starts[..])
    }
}

fn is_same_voxel(a: &Record, b: &Record) -> bool {
    a.cell == b.cell
}

/// Records by voxel, and of each voxel the widest first.
fn by_voxel(records: impl Iterator<Item = Record> + Clone, voxels: usize) -> Vec<Record> {
    let mut ends = vec![0_usize; voxels + 1];
    records.clone().for_each(|record| ends[record.cell as usize + 1] += 1);
    (0..voxels).for_each(|voxel| ends[voxel + 1] += ends[voxel]);
    let empty = Record { cell: 0, at_m: [0.0; 3], width_m: 0.0 };
    let mut sorted = vec![empty; ends[voxels]];
    // where the next record of each voxel goes: in the end, where the next voxel begins
    for record in records {
        let end = &mut ends[record.cell as usize];
        sorted[*end] = record;
        *end += 1;
    }
    sorted.chunk_by_mut(is_same_voxel).for_each(|own| own.sort_by(|a, b| b.width_m.total_cmp(&a.width_m)));
    sorted
}
