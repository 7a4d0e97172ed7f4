"""Other people's optimizers on the published objective, at equal budgets: medians over seeds, as JSON.

    cargo build --release --example objective
    python tests/peers/optimizers.py target/release/examples/objective PRESET lateral|forward [--seeds N] [--methods a,b]

The space is the published one: masters 1..5 (an integer), then x, y, z, pitch and roll of each (roll counts for nothing where
it is fixed). Methods: random; ga (pymoo's GA, population 80); pso (60 particles, inertia 0.7, c1 = c2 = 1.4: the published
setting); pyswarms (its global-best swarm with the same setting); bo (scikit-optimize's gp_minimize, 12 initial points).
"""

import argparse
import json
import subprocess
import warnings

import numpy as np

warnings.filterwarnings("ignore")
LOW = np.array([1.0] + 5 * [-0.10, -0.25, -0.15, -90.0, -90.0])
HIGH = np.array([5.0] + 5 * [0.15, 0.25, 0.15, 90.0, 90.0])
PARTICLES, INERTIA, PULL, POPULATION, FIRST = 60, 0.7, 1.4, 80, 12


class Spent(Exception):
    """The budget is used up."""


class Objective:
    """Counts evaluations and keeps the best J after each; stops the method at the budget."""

    def __init__(self, program, preset, path, budget):
        self.process = subprocess.Popen([program, preset, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        self.budget, self.best = budget, []

    def __call__(self, point):
        if len(self.best) == self.budget:
            raise Spent
        point = np.clip(np.asarray(point, float), LOW, HIGH)
        masters = point[1:].reshape(5, 5)[: int(np.clip(np.rint(point[0]), 1, 5))]
        self.process.stdin.write(json.dumps(masters.tolist()) + "\n")
        value = float(self.process.stdout.readline())
        self.best.append(max(value, self.best[-1] if self.best else -np.inf))
        return value

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def random(objective, seed):
    rng = np.random.default_rng(seed)
    while True:
        objective(rng.uniform(LOW, HIGH))


def pso(objective, seed):
    rng = np.random.default_rng(seed)
    here = rng.uniform(LOW, HIGH, (PARTICLES, len(LOW)))
    speed = rng.uniform(-1, 1, here.shape) * (HIGH - LOW) * 0.5
    own, own_value = here.copy(), np.array([objective(p) for p in here])
    while True:
        shared = own[own_value.argmax()]
        r1, r2 = rng.uniform(size=here.shape), rng.uniform(size=here.shape)
        speed = INERTIA * speed + PULL * r1 * (own - here) + PULL * r2 * (shared - here)
        there = np.clip(here + speed, LOW, HIGH)
        speed = np.where(there == here + speed, speed, 0.0)
        here = there
        value = np.array([objective(p) for p in here])
        better = value > own_value
        own[better], own_value[better] = here[better], value[better]


def ga(objective, seed):
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    class Mounts(Problem):
        def __init__(self):
            super().__init__(n_var=len(LOW), n_obj=1, xl=LOW, xu=HIGH)

        def _evaluate(self, x, out, *args, **kwargs):
            out["F"] = np.array([[-objective(p)] for p in x])

    first = np.random.default_rng(seed).uniform(LOW, HIGH, (POPULATION, len(LOW)))
    minimize(Mounts(), GA(pop_size=POPULATION, sampling=first), ("n_gen", 100_000), seed=seed)


def pyswarms(objective, seed):
    from pyswarms.single import GlobalBestPSO

    np.random.seed(seed)
    swarm = GlobalBestPSO(PARTICLES, len(LOW), {"c1": PULL, "c2": PULL, "w": INERTIA}, bounds=(LOW, HIGH))
    swarm.optimize(lambda points: np.array([-objective(p) for p in points]), 100_000, verbose=False)


def bo(objective, seed):
    from skopt import gp_minimize
    from skopt.space import Integer, Real

    space = [Integer(1, 5)] + [Real(low, high) for low, high in zip(LOW[1:], HIGH[1:])]
    gp_minimize(lambda p: -objective(p), space, n_calls=objective.budget, n_initial_points=FIRST, acq_func="EI", random_state=seed)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("preset")
    parser.add_argument("path")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--methods", default="random,ga,pso,pyswarms,bo")
    parser.add_argument("--budgets", default="56,80,300,1000,3500")
    parser.add_argument("--bo-budget", type=int, default=80, help="scikit-optimize needs minutes beyond")
    options = parser.parse_args()
    budgets = [int(b) for b in options.budgets.split(",")]
    for method in options.methods.split(","):
        most = options.bo_budget if method == "bo" else max(budgets)
        histories = []
        for seed in range(1, options.seeds + 1):
            objective = Objective(options.program, options.preset, options.path, most)
            try:
                globals()[method](objective, seed)
            except Spent:
                pass
            objective.close()
            histories.append(objective.best)
        for budget in (b for b in budgets if b <= most):
            values = np.array([history[min(budget, len(history)) - 1] for history in histories])
            low, median, high = np.percentile(values, [25, 50, 75]).round(1)
            print(json.dumps({"preset": options.preset, "path": options.path, "method": method, "evaluations": budget,
                              "median": median, "q25": low, "q75": high, "seeds": len(values)}), flush=True)


if __name__ == "__main__":
    main()
