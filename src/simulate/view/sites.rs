//! Several sites as one: what a rig sees of each, and the weighted mean of that.

use sensors::SensorModel;

use super::{BuildCost, CastView, CellView, Fan, Scans, Seen, View};
use crate::rig::Rig;
use crate::world::coverage::Coverage;

/// The exact views of some sites.
pub(crate) struct CastSites {
    views: Vec<CastView>,
    /// What a voxel of each site counts.
    scales: Vec<f64>,
}

impl CastSites {
    pub(crate) fn new(views: Vec<CastView>, scales: Vec<f64>) -> Self {
        Self { views, scales }
    }

    pub(crate) fn views(&self) -> &[CastView] {
        &self.views
    }

    /// The same with the first column of every revolution turned on by so many columns.
    pub(crate) fn at_phase(&self, phase: f64) -> Self {
        self.changed(|view| view.at_phase(phase))
    }

    /// The same with one revolution in so many.
    pub(crate) fn every(&self, times: u64) -> Self {
        self.changed(|view| view.every(times))
    }

    fn changed(&self, view: impl Fn(&CastView) -> CastView) -> Self {
        Self { views: self.views.iter().map(view).collect(), scales: self.scales.clone() }
    }

    /// Beams of a rig.
    pub(crate) fn rays(&self, rig: &Rig) -> u64 {
        self.views.iter().map(|view| view.rays(rig)).sum()
    }

    /// The beams of a model and its revolutions at each site.
    pub(crate) fn fans_of(&self, model: &SensorModel) -> Vec<&(Fan, Scans)> {
        self.views.iter().map(|view| view.fan_of(model)).collect()
    }

    /// What each of these rigs sees.
    pub(crate) fn see(&self, rigs: &[Rig]) -> Vec<Seen> {
        joined(&self.scales, self.views.iter().map(|view| view.see(rigs)).collect())
    }

    /// What a rig sees, and by site the voxels that each of its sensors does.
    pub(crate) fn cover(&self, rig: &Rig) -> (Seen, Vec<Coverage>) {
        let covered: Vec<Coverage> = self.views.iter().map(|view| view.cover(rig)).collect();
        let sites = self.views.iter().zip(&covered);
        let seen = sites.map(|(view, coverage)| vec![Seen::exact(&coverage.counts(), view.rays(rig))]);
        (joined(&self.scales, seen.collect()).swap_remove(0), covered)
    }
}

/// The models of some sites.
pub(crate) struct CellSites {
    views: Vec<CellView>,
    scales: Vec<f64>,
}

impl CellSites {
    pub(crate) fn new(views: Vec<CellView>, scales: Vec<f64>) -> Self {
        Self { views, scales }
    }

    pub(crate) fn views(&self) -> &[CellView] {
        &self.views
    }

    /// What they took: sums, and the coarsest rays.
    pub(crate) fn cost(&self) -> BuildCost {
        let costs = self.views.iter().map(CellView::cost);
        let joined = costs.reduce(|all, more| BuildCost {
            views: all.views + more.views,
            layers: all.layers.max(more.layers),
            step_rad: all.step_rad.max(more.step_rad),
            rays: all.rays + more.rays,
            bytes: all.bytes + more.bytes,
            is_bound_by_memory: all.is_bound_by_memory || more.is_bound_by_memory,
            is_bound_by_rays: all.is_bound_by_rays || more.is_bound_by_rays,
        });
        joined.unwrap_or_default()
    }

    /// Voxels that `see_roughly` takes to be seen.
    pub(crate) fn certain_voxels(&self) -> usize {
        self.views.iter().map(CellView::certain_voxels).sum()
    }

    /// As [`CellView::see_roughly`].
    pub(crate) fn see_roughly(&self, rigs: &[Rig], stride: usize) -> Vec<Seen> {
        joined(&self.scales, self.views.iter().map(|view| view.see_roughly(rigs, stride)).collect())
    }

    /// As [`CellView::see_sparsely`].
    pub(crate) fn see_sparsely(&self, rigs: &[Rig], stride: usize) -> Vec<Seen> {
        joined(&self.scales, self.views.iter().map(|view| view.see_sparsely(rigs, stride)).collect())
    }

    /// As [`CellView::focus`].
    pub(crate) fn focus(&mut self, rigs: &[Rig]) {
        self.views.iter_mut().for_each(|view| view.focus(rigs));
    }

    /// As [`CellView::unfocus`].
    pub(crate) fn unfocus(&mut self) {
        self.views.iter_mut().for_each(CellView::unfocus);
    }
}

/// By rig, of what is seen by site and rig. Of one site it is that.
fn joined(scales: &[f64], mut by_site: Vec<Vec<Seen>>) -> Vec<Seen> {
    if by_site.len() == 1 {
        return by_site.swap_remove(0);
    }
    let rigs = by_site.first().map_or(0, Vec::len);
    let of_rig = |rig: usize| {
        let by_site: Vec<Seen> = by_site.iter().map(|seen| seen[rig].clone()).collect();
        let mean = |value: &dyn Fn(&Seen) -> f64| {
            let sum = scales.iter().zip(&by_site).map(|(scale, seen)| scale * value(seen)).sum::<f64>();
            sum / by_site.len() as f64
        };
        let sensors = by_site[0].per_sensor.len();
        Seen {
            per_sensor: (0..sensors).map(|sensor| mean(&|seen| seen.per_sensor[sensor])).collect(),
            union: mean(&|seen| seen.union),
            overlap: mean(&|seen| seen.overlap),
            sd_voxels: by_site[0].sd_voxels,
            rays: by_site.iter().map(|seen| seen.rays).sum(),
            by_site,
        }
    };
    (0..rigs).map(of_rig).collect()
}
