//! Beams cast side by side in single precision, and the bits of the voxels that they meet.

use std::sync::atomic::{AtomicU16, Ordering};

use glam::{DMat3, DVec3};

use super::fan::FanBeam;
use super::{Fan, ViewSite};
use crate::base::instructions::{Instructions, Kernel};
use crate::world::scene::{Mesh, PACKET, RayTile};

/// Beams of one sensor through a mesh.
pub(super) struct Tiles<'a> {
    pub site: &'a ViewSite,
    pub mesh: &'a Mesh,
    pub fan: &'a Fan,
    pub instructions: Instructions,
}

impl Tiles<'_> {
    /// Marks the voxels that one revolution meets. `columns` are world from the frame of each column, `shade` is where
    /// each beam is stopped, column by column, m.
    pub(crate) fn mark(&self, columns: &[(DMat3, DVec3)], shade: Option<&[f32]>, marks: Marks<'_>) {
        let centre_m = self.mesh.centre_m();
        let columns: Vec<Column> = columns.iter().map(|column| Column::about(centre_m, column)).collect();
        let beams: Vec<Beam> = self.fan.beams.iter().map(Beam::of).collect();
        let pattern: Option<Vec<[f32; 4]>> =
            self.fan.pattern().map(|directions| directions.iter().map(four).collect());
        let is_strict = !marks.hits.is_empty() || self.fan.min_cosine > 0.0;
        let marking = Marking::<false> {
            tiles: self,
            grid: Grid::new(self.site, centre_m),
            has_origins: beams.iter().any(|beam| beam.origin_m != [0.0; 4]),
            columns: &columns,
            beams: &beams,
            pattern: pattern.as_deref(),
            shade,
            marks,
        };
        if is_strict { self.instructions.run(marking.strict()) } else { self.instructions.run(marking) }
    }

    /// Beams that are cast together; as many columns as fill the packet. The flatter the bundle, the fewer boxes it meets.
    fn beams_together(&self) -> usize {
        let elevations_rad: Vec<f64> = self.fan.elevations_rad().collect();
        let rows = elevations_rad.len();
        let row_rad = (elevations_rad[rows - 1] - elevations_rad[0]) / (rows - 1).max(1) as f64;
        let column_rad = std::f64::consts::TAU / self.fan.columns as f64;
        let edge_rad = |rows: usize| rows as f64 * row_rad + (PACKET / rows) as f64 * column_rad;
        let powers = (0..=PACKET.ilog2()).rev().map(|power| 1 << power);
        let candidates = powers.filter(|together| *together <= rows);
        candidates.min_by(|a, b| edge_rad(*a).total_cmp(&edge_rad(*b))).unwrap_or(1)
    }
}

/// Where the returns of one sensor are noted.
pub(super) struct Marks<'a> {
    pub bitmap: &'a mut [u64],
    /// Returns of the whole rig by voxel; empty where they are not counted.
    pub hits: &'a [AtomicU16],
}

/// Returns of a voxel beyond this are not counted.
pub(super) const MANY_HITS: u16 = 1 << 15;

impl Marks<'_> {
    #[inline(always)]
    pub(crate) fn mark(&mut self, cell: usize) {
        self.bitmap[cell / 64] |= 1 << (cell % 64);
        if let Some(hits) = self.hits.get(cell).filter(|hits| hits.load(Ordering::Relaxed) < MANY_HITS) {
            hits.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The column with a beam of this shift that points where an unstaggered one of `column` does.
pub(super) fn shifted(column: usize, shift: usize, columns: usize) -> usize {
    let moved = column + columns - shift;
    if moved >= columns { moved - columns } else { moved }
}

fn four(v: &DVec3) -> [f32; 4] {
    [v.x as f32, v.y as f32, v.z as f32, 0.0]
}

/// World from the frame of a column, about the mesh's centre.
struct Column {
    axes: [[f32; 4]; 3],
    origin_m: [f32; 4],
}

impl Column {
    fn about(centre_m: DVec3, (axes, origin_m): &(DMat3, DVec3)) -> Self {
        let axes = [axes.x_axis, axes.y_axis, axes.z_axis];
        Self { axes: axes.each_ref().map(four), origin_m: four(&(*origin_m - centre_m)) }
    }

    #[inline(always)]
    fn turned(&self, v: [f32; 4]) -> [f32; 4] {
        let mut turned = [0.0; 4];
        for (at, value) in turned.iter_mut().enumerate() {
            *value = self.axes[0][at] * v[0] + self.axes[1][at] * v[1] + self.axes[2][at] * v[2];
        }
        turned
    }
}

/// A beam in the frame of its column.
struct Beam {
    direction: [f32; 4],
    origin_m: [f32; 4],
    range_offset_m: f32,
    shift: usize,
}

impl Beam {
    fn of(beam: &FanBeam) -> Self {
        Self {
            direction: four(&beam.direction),
            origin_m: four(&beam.origin_m),
            range_offset_m: beam.range_offset_m as f32,
            shift: beam.shift,
        }
    }
}

/// One revolution. `STRICT`: with angles of incidence and numbers of returns.
struct Marking<'a, const STRICT: bool> {
    tiles: &'a Tiles<'a>,
    grid: Grid,
    /// Some beam leaves the sensor elsewhere than at its origin.
    has_origins: bool,
    columns: &'a [Column],
    beams: &'a [Beam],
    pattern: Option<&'a [[f32; 4]]>,
    shade: Option<&'a [f32]>,
    marks: Marks<'a>,
}

impl<'a> Marking<'a, false> {
    fn strict(self) -> Marking<'a, true> {
        let Self { tiles, grid, has_origins, columns, beams, pattern, shade, marks } = self;
        Marking { tiles, grid, has_origins, columns, beams, pattern, shade, marks }
    }
}

impl<const STRICT: bool> Kernel for Marking<'_, STRICT> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { tiles, grid, has_origins, columns, beams, pattern, shade, mut marks } = self;
        let (min_m, max_m) = (tiles.fan.min_range_m as f32, tiles.fan.max_range_m as f32);
        let rows = tiles.beams_together();
        let together = PACKET / rows;
        let mut origins_m = [[0.0_f32; 4]; PACKET];
        let mut directions = [[0.0_f32; 4]; PACKET];
        let mut offsets_m = [0.0_f32; PACKET];
        let mut free_m = [f32::INFINITY; PACKET];
        let mut rays = RayTile::EMPTY;
        for first in (0..columns.len()).step_by(together) {
            for (chunk, beams_of_chunk) in beams.chunks(rows).enumerate() {
                let mut count = 0;
                for column in first..columns.len().min(first + together) {
                    for (number, beam) in beams_of_chunk.iter().enumerate() {
                        let at = column * beams.len() + chunk * rows + number;
                        let own = pattern.map_or(beam.direction, |directions| directions[at]);
                        let turning = &columns[shifted(column, beam.shift, columns.len())];
                        directions[count] = turning.turned(own);
                        origins_m[count] = turning.origin_m;
                        if has_origins {
                            let from_m = turning.turned(beam.origin_m);
                            for axis in 0..3 {
                                origins_m[count][axis] += from_m[axis];
                            }
                        }
                        offsets_m[count] = beam.range_offset_m;
                        free_m[count] = shade.map_or(f32::INFINITY, |free_m| free_m[at]);
                        count += 1;
                    }
                }
                for element in count..PACKET {
                    (directions[element], origins_m[element]) = (directions[0], origins_m[0]);
                    (offsets_m[element], free_m[element]) = (offsets_m[0], free_m[0]);
                }
                for axis in 0..3 {
                    for element in 0..PACKET {
                        rays.direction[axis][element] = directions[element][axis];
                        rays.origin_m[axis][element] = origins_m[element][axis];
                    }
                }
                let is_angle_limited = STRICT && tiles.fan.min_cosine > 0.0;
                let (distances_m, cosines) = if is_angle_limited {
                    tiles.mesh.cast_tile_with_cosines(&rays, max_m, tiles.instructions)
                } else {
                    (tiles.mesh.cast_tile(&rays, max_m, tiles.instructions), [1.0; PACKET])
                };
                let mut indices = grid.indices(&rays, &distances_m);
                for element in 0..PACKET {
                    let range_m = distances_m[element] + offsets_m[element];
                    let is_in_range =
                        (range_m >= min_m) & (range_m <= max_m) & (distances_m[element] < free_m[element]);
                    indices[element] = if is_in_range { indices[element] } else { OUTSIDE };
                }
                if STRICT {
                    for element in 0..count {
                        if indices[element] != OUTSIDE && cosines[element] >= tiles.fan.min_cosine {
                            marks.mark(indices[element] as usize);
                        }
                    }
                    continue;
                }
                for index in indices {
                    if index != OUTSIDE {
                        marks.bitmap[index as usize / 64] |= 1 << (index % 64);
                    }
                }
            }
        }
    }
}

/// No voxel of the grid.
const OUTSIDE: u32 = u32::MAX;

/// The grid about the mesh's centre.
struct Grid {
    origin_m: [f32; 3],
    per_m: f32,
    cells: [f32; 3],
    stride: [u32; 3],
}

impl Grid {
    fn new(site: &ViewSite, centre_m: DVec3) -> Self {
        let grid = &site.grid;
        let [nx, ny, _] = grid.cells;
        Self {
            origin_m: (grid.origin_m - centre_m).as_vec3().to_array(),
            per_m: (1.0 / grid.voxel_m) as f32,
            cells: grid.cells.map(|count| count as f32),
            stride: [1, nx as u32, (nx * ny) as u32],
        }
    }

    /// Voxels around the points that rays meet.
    #[inline(always)]
    fn indices(&self, rays: &RayTile, distances_m: &[f32; PACKET]) -> [u32; PACKET] {
        let mut indices = [0_u32; PACKET];
        let mut inside = [true; PACKET];
        for axis in 0..3 {
            for element in 0..PACKET {
                let at_m =
                    rays.origin_m[axis][element] + distances_m[element] * rays.direction[axis][element];
                let cell = (at_m - self.origin_m[axis]) * self.per_m;
                inside[element] &= (cell >= 0.0) & (cell < self.cells[axis]);
                indices[element] = indices[element].wrapping_add(whole(cell).wrapping_mul(self.stride[axis]));
            }
        }
        for element in 0..PACKET {
            indices[element] = if inside[element] { indices[element] } else { OUTSIDE };
        }
        indices
    }
}

/// The floor of what lies between 0 and 2^31, and something for the rest. What `as` does is done one by one.
#[allow(unsafe_code)] // a conversion that is undefined outside its range
#[inline(always)]
fn whole(value: f32) -> u32 {
    const MOST: f32 = 2_147_483_520.0;
    let value = if value > 0.0 { value } else { 0.0 };
    let value = if value < MOST { value } else { MOST };
    // SAFETY: between 0 and the greatest number of f32 below 2^31; what is no number became 0
    unsafe { value.to_int_unchecked::<i32>() as u32 }
}
