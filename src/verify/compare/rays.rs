//! Recorded frames laid against the scene, ray by ray.

use glam::DVec3;
use rayon::prelude::*;
use sensors::Frame;
use sensors::projection::{sample_azimuth_rad, sample_time_ns};

use super::surface::{Patches, SurfaceTally};
use super::{Breakdown, RayClass, RayClasses, RecordedRay, Thinning};
use crate::base::geometry::Pose;
use crate::recording::FramePitch;
use crate::rig::{Mount, MountedSensor};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::{Hit, Scene};
use crate::world::trajectory::Trajectory;

/// How rays are compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// A recorded and a predicted range agree within this, m. Source: max(3 sigma, 0.10 m) for a range sd of at most
    /// 3 cm.
    pub agree_within_m: f64,
    /// So many rays are held to be cast again.
    pub keep_rays: usize,
    /// Added to the recording's times to get those of the trajectory, ns.
    pub time_offset_ns: i64,
}

impl Default for Gate {
    fn default() -> Self {
        Self { agree_within_m: 0.10, keep_rays: 1_000_000, time_offset_ns: 0 }
    }
}

/// Recorded frames go in, the coverage as driven and as recorded comes out.
pub struct Replay<'a> {
    scene: &'a Scene,
    trajectory: &'a Trajectory,
    sensors: Vec<MountedSensor>,
    gate: Gate,
    surface: Option<SurfaceTally<'a>>,
    /// One per thread, so that threads never wait for each other.
    shards: Vec<Shard>,
}

/// What one thread has seen.
struct Shard {
    as_driven: Coverage,
    recorded: Coverage,
    placed: Coverage,
    breakdown: Vec<Breakdown>,
    sampled: Thinning,
}

/// Everything that a recording says about its prediction.
pub struct Replayed {
    /// Sensors, with the models of their packets.
    pub sensors: Vec<MountedSensor>,
    /// What the scene promises for the rays that were recorded.
    pub as_driven: Coverage,
    /// The predicted points of the rays that agree: errors can only make it less.
    pub recorded: Coverage,
    /// The points as measured, wherever they fell.
    pub placed: Coverage,
    /// Per sensor.
    pub rays: Vec<RayClasses>,
    /// Per sensor.
    pub breakdown: Vec<Breakdown>,
    /// An even share of the rays, in order of time.
    pub sampled: Vec<RecordedRay>,
    /// Samples of the surface, where they were asked for.
    pub surface: Option<super::SurfaceCovered>,
}

impl<'a> Replay<'a> {
    /// Nothing replayed yet.
    pub fn new(
        scene: &'a Scene,
        trajectory: &'a Trajectory,
        sensors: Vec<MountedSensor>,
        grid: &VoxelGrid,
        gate: Gate,
    ) -> Self {
        let count = sensors.len();
        let shard = || Shard {
            as_driven: Coverage::new(grid.clone(), count),
            recorded: Coverage::new(grid.clone(), count),
            placed: Coverage::new(grid.clone(), count),
            breakdown: vec![Breakdown::default(); count],
            sampled: Thinning::new(gate.keep_rays),
        };
        let shards = (0..rayon::current_num_threads().max(1)).map(|_| shard()).collect();
        Self { scene, trajectory, sensors, gate, surface: None, shards }
    }

    /// Also counts the samples of a surface.
    pub fn with_surface(mut self, patches: &'a Patches) -> Self {
        self.surface = Some(SurfaceTally::new(patches));
        self
    }

    /// The beams of a sensor, as its packets or metadata say them.
    pub(crate) fn set_model(&mut self, sensor: usize, model: &sensors::SensorModel) {
        if self.sensors[sensor].model != *model {
            self.sensors[sensor].model = model.clone();
        }
    }

    /// Lays one frame of a sensor against the scene. Columns that never came are neither predicted nor recorded: their
    /// loss is the receiver's to report.
    pub fn add_frame(&mut self, sensor: usize, frame: &Frame) {
        let nominal = FramePitch::constant(self.sensors[sensor].mount.pitch_rad);
        self.add_pitched_frame(sensor, &nominal, frame);
    }

    /// The same of a sensor that had this pitch meanwhile: the angle its axis measured.
    pub(crate) fn add_pitched_frame(&mut self, sensor: usize, pitch: &FramePitch, frame: &Frame) {
        self.sensors[sensor].mount.pitch_rad = pitch.mean_rad();
        let lay = Lay {
            pitch,
            scene: self.scene,
            trajectory: self.trajectory,
            mounted: &self.sensors[sensor],
            sensor,
            gate: self.gate,
            surface: self.surface.as_ref(),
            frame,
        };
        let per_shard = frame.columns().div_ceil(self.shards.len()).max(1);
        self.shards.par_iter_mut().enumerate().for_each(|(place, shard)| {
            let end = frame.columns().min((place + 1) * per_shard);
            lay.columns(place * per_shard..end, shard);
        });
    }

    /// Makes later frames faster; changes no outcome.
    pub(crate) fn settle(&mut self) {
        if let Some(surface) = &mut self.surface {
            surface.settle();
        }
    }

    /// The end of the recording.
    pub fn finish(self) -> Replayed {
        let mut shards = self.shards.into_iter();
        #[expect(clippy::unwrap_used, reason = "made with at least one")]
        let mut all = shards.next().unwrap();
        let mut samples = Vec::new();
        for shard in shards {
            all.as_driven.join(&shard.as_driven);
            all.recorded.join(&shard.recorded);
            all.placed.join(&shard.placed);
            all.breakdown.iter_mut().zip(&shard.breakdown).for_each(|(own, more)| own.join(more));
            samples.push(shard.sampled);
        }
        samples.push(all.sampled);
        Replayed {
            sensors: self.sensors,
            as_driven: all.as_driven,
            recorded: all.recorded,
            placed: all.placed,
            rays: all.breakdown.iter().map(Breakdown::total).collect(),
            breakdown: all.breakdown,
            sampled: Thinning::joined(samples),
            surface: self.surface.map(SurfaceTally::finish),
        }
    }
}

/// One frame against the scene.
struct Lay<'a> {
    scene: &'a Scene,
    trajectory: &'a Trajectory,
    mounted: &'a MountedSensor,
    sensor: usize,
    gate: Gate,
    surface: Option<&'a SurfaceTally<'a>>,
    pitch: &'a FramePitch,
    frame: &'a Frame,
}

/// One ray of a column.
struct Fired {
    channel: usize,
    time_ns: u64,
    azimuth_rad: f64,
    pitch_rad: f64,
    range_offset_m: f64,
    world_from_sensor: Pose,
}

impl Lay<'_> {
    fn columns(&self, columns: std::ops::Range<usize>, shard: &mut Shard) {
        let channels = self.frame.channels.min(self.mounted.model.channels());
        let (mut origins_m, mut directions, mut fired) = (Vec::new(), Vec::new(), Vec::<Fired>::new());
        let mut adder = self.surface.map(SurfaceTally::adder);
        for column in columns.filter(|column| self.frame.column_valid[*column]) {
            origins_m.clear();
            directions.clear();
            fired.clear();
            let mut last: Option<(u64, Option<Pose>)> = None;
            let pitch_rad = self.pitch.at(self.frame.column_time_ns[column]);
            let body_from_sensor = Mount { pitch_rad, ..self.mounted.mount }.body_from_sensor();
            for channel in 0..channels {
                let time_ns = sample_time_ns(&self.mounted.model, self.frame, column, channel)
                    .saturating_add_signed(self.gate.time_offset_ns);
                let pose = match last {
                    Some((at_ns, pose)) if at_ns == time_ns => pose,
                    _ => {
                        self.trajectory.at(time_ns).map(|world_from_body| world_from_body * body_from_sensor)
                    }
                };
                last = Some((time_ns, pose));
                let azimuth_rad = sample_azimuth_rad(&self.mounted.model, self.frame, column, channel);
                let Some(world_from_sensor) = pose else {
                    shard.breakdown[self.sensor].count(channel, azimuth_rad, None, RayClass::Unplaced);
                    continue;
                };
                let ray = self.mounted.model.ray(channel, azimuth_rad);
                origins_m.push(world_from_sensor.transform_point(ray.origin_m));
                directions.push(world_from_sensor.rotate(ray.direction));
                let range_offset_m = ray.range_offset_m;
                fired.push(Fired {
                    channel,
                    time_ns,
                    azimuth_rad,
                    pitch_rad,
                    range_offset_m,
                    world_from_sensor,
                });
            }
            self.scene.cast_many(&origins_m, &directions, |ray, hit| {
                self.ray(column, &fired[ray], origins_m[ray], directions[ray], hit, shard, adder.as_mut());
            });
        }
    }

    #[expect(clippy::too_many_arguments, reason = "one ray in parts, in the innermost loop")]
    fn ray(
        &self,
        column: usize,
        fired: &Fired,
        origin_m: DVec3,
        direction: DVec3,
        hit: Option<Hit>,
        shard: &mut Shard,
        adder: Option<&mut super::SurfaceAdder>,
    ) {
        let model = &self.mounted.model;
        let predicted = hit.filter(|hit| {
            let range_m = hit.distance_m + fired.range_offset_m;
            (model.min_range_m..=model.max_range_m).contains(&range_m)
        });
        let raw_mm = self.frame.first.range_mm[self.frame.index(column, fired.channel)];
        let recorded_m = (raw_mm > 0).then(|| f64::from(raw_mm) * 1e-3);
        let predicted_m = predicted.map(|hit| hit.distance_m + fired.range_offset_m);
        // a calibrated HDL-64E does not place near points on a straight ray
        let placed_point = recorded_m.map(|range_m| {
            let point = model.point(fired.channel, fired.azimuth_rad, range_m);
            fired.world_from_sensor.transform_point(point)
        });
        let gate_m = self.gate.agree_within_m;
        let class = RayClass::in_scene(self.scene, predicted_m, recorded_m, gate_m, |_| placed_point);
        let cosine = predicted.map(|hit| -hit.normal.dot(direction));
        shard.breakdown[self.sensor].count(fired.channel, fired.azimuth_rad, cosine, class);
        let predicted_point = predicted.map(|hit| origin_m + hit.distance_m * direction);
        if let Some(point_m) = predicted_point {
            shard.as_driven.add(self.sensor, point_m);
            if class == RayClass::Agree {
                shard.recorded.add(self.sensor, point_m);
            }
        }
        if let Some(point_m) = placed_point {
            shard.placed.add(self.sensor, point_m);
        }
        if let (Some(surface), Some(adder)) = (self.surface, adder) {
            surface.add(adder, predicted_point, class == RayClass::Agree, placed_point);
        }
        if shard.sampled.wants(self.sensor, fired.channel, fired.time_ns) {
            shard.sampled.push(RecordedRay {
                sensor: self.sensor,
                channel: fired.channel,
                time_ns: fired.time_ns,
                azimuth_rad: fired.azimuth_rad,
                pitch_rad: fired.pitch_rad,
                range_m: recorded_m,
            });
        }
    }
}
