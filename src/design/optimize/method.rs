//! The methods by name.

use serde::{Deserialize, Serialize};

use super::{
    Bayesian, Candidate, CmaEs, DifferentialEvolution, Genetic, Optimizer, ParticleSwarm, Pattern, Random,
    Settings, Space, Staged, Trial,
};

/// The methods by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Few sensors first, proofs, a model, then local evolution.
    Staged,
    /// Uniform random search.
    Random,
    /// Random search, then pattern search.
    Pattern,
    /// Gaussian process and expected improvement (`bo` for short).
    #[value(alias = "bo")]
    Bayesian,
    /// Genetic algorithm, then pattern search (`ga` for short).
    #[value(alias = "ga")]
    Genetic,
    /// Particle swarm, then pattern search (`pso` for short).
    #[value(alias = "pso")]
    ParticleSwarm,
    /// Covariance matrix adaptation with margin for integers.
    CmaEs,
    /// Differential evolution with success-history adaptation (`de` for short).
    #[value(alias = "de")]
    DifferentialEvolution,
}

impl Kind {
    /// Every method.
    pub const ALL: &[Kind] = &[
        Kind::Staged,
        Kind::Random,
        Kind::Pattern,
        Kind::Bayesian,
        Kind::Genetic,
        Kind::ParticleSwarm,
        Kind::CmaEs,
        Kind::DifferentialEvolution,
    ];

    /// The method, nothing evaluated yet.
    pub(crate) fn start(self, space: Space, settings: Settings) -> Method {
        match self {
            Kind::Staged => Method::Staged(Box::new(Staged::new(space, settings))),
            Kind::Random => Method::Random(Random::new(space, settings)),
            Kind::Pattern => Method::Pattern(Pattern::new(space, settings)),
            Kind::Bayesian => Method::Bayesian(Box::new(Bayesian::new(space, settings))),
            Kind::Genetic => Method::Genetic(Box::new(Genetic::start(space, settings))),
            Kind::ParticleSwarm => Method::ParticleSwarm(Box::new(ParticleSwarm::start(space, settings))),
            Kind::CmaEs => Method::CmaEs(Box::new(CmaEs::new(space, settings))),
            Kind::DifferentialEvolution => {
                Method::DifferentialEvolution(Box::new(DifferentialEvolution::new(space, settings)))
            }
        }
    }

    /// Evaluations at most when none are asked for: the published runs of the published methods, with room for the
    /// closing pattern search.
    pub fn published_budget(self) -> usize {
        match self {
            Kind::Staged | Kind::Random | Kind::Pattern => 1_000,
            Kind::Bayesian => 300,
            Kind::Genetic => 10_000,
            Kind::ParticleSwarm => 6_000,
            Kind::CmaEs | Kind::DifferentialEvolution => 3_500,
        }
    }

    /// Whether a model proposes its points: in batches, by an acquisition.
    pub(crate) fn has_a_model(self) -> bool {
        matches!(self, Kind::Staged | Kind::Bayesian)
    }

    /// Whether a rule was published by which it stops.
    pub(crate) fn has_a_rule(self) -> bool {
        matches!(self, Kind::Bayesian | Kind::Genetic | Kind::ParticleSwarm)
    }

    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Staged => "staged",
            Kind::Random => "random",
            Kind::Pattern => "pattern",
            Kind::Bayesian => "bayesian",
            Kind::Genetic => "genetic",
            Kind::ParticleSwarm => "particle-swarm",
            Kind::CmaEs => "cma-es",
            Kind::DifferentialEvolution => "differential-evolution",
        }
    }
}

/// Any method with its whole state.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// See [`Staged`].
    Staged(Box<Staged>),
    /// See [`Random`].
    Random(Random),
    /// See [`Pattern`].
    Pattern(Pattern),
    /// See [`Bayesian`].
    Bayesian(Box<Bayesian>),
    /// See [`Genetic`].
    Genetic(Box<Genetic>),
    /// See [`ParticleSwarm`].
    ParticleSwarm(Box<ParticleSwarm>),
    /// See [`CmaEs`].
    CmaEs(Box<CmaEs>),
    /// See [`DifferentialEvolution`].
    DifferentialEvolution(Box<DifferentialEvolution>),
}

impl Method {
    fn as_optimizer(&mut self) -> &mut dyn Optimizer {
        match self {
            Method::Staged(method) => method.as_mut(),
            Method::Random(method) => method,
            Method::Pattern(method) => method,
            Method::Bayesian(method) => method.as_mut(),
            Method::Genetic(method) => method.as_mut(),
            Method::ParticleSwarm(method) => method.as_mut(),
            Method::CmaEs(method) => method.as_mut(),
            Method::DifferentialEvolution(method) => method.as_mut(),
        }
    }
}

impl Optimizer for Method {
    fn ask(&mut self) -> Vec<Candidate> {
        self.as_optimizer().ask()
    }

    fn tell(&mut self, trials: &[Trial]) {
        self.as_optimizer().tell(trials);
    }
}
