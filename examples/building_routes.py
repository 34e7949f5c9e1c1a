"""Which stair to send pedestrians to: rules beside the best plan in hindsight, on the same draws of a building.

``python -m examples.building_routes --draws 10``: in `building-v0` visitors know one exit, one stair fills, and the exit in the
east shuts after 60 s.  A plan names an exit for each half of each storey, once and for all.  Hindsight searches the best plan
of each draw, one half after the other: nobody can know it before, so it bounds what a controller of ``crowd_env/routing-v0``
can gain that sends people so.
"""

import argparse
import itertools

import numpy as np

from crowd_env import CrowdEnv, make_scenario
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.scenarios.scenario import Scenario

RULES = ("nearest", "shortest", "fastest")
_SWEEPS = 2


def time_of_rule(rule: str, place: Scenario, seed: int, law: str) -> float:
    """Return the time [s] of the last pedestrian under a rule; infinite if one is left inside."""
    env = CrowdEnv(place, physics=law, routing=rule)
    env.reset(seed=seed)
    while not env.finished.all():
        step = env.step(None)
    return _last(step.info["metrics"][0])


class Plans:
    """Plans of one draw, run side by side: for each half of a storey the number of the exit that its people are sent to."""

    def __init__(self, place: Scenario, seed: int, law: str) -> None:
        self.halves = [name for name in place.geometry.regions if ", " in name]
        make = {"physics": law, "regions": self.halves, "num_envs": len(self.halves)}
        self._batch, self._seed, self.known = RoutingBatch(place, **make), seed, dict[tuple[int, ...], float]()

    def run(self, plans: list[tuple[int, ...]]) -> None:
        """Find the times of plans, as many at once as there are halves."""
        fresh = list(dict.fromkeys(plan for plan in plans if plan not in self.known))
        if not fresh:
            return
        rows = np.array([fresh[k % len(fresh)] for k in range(len(self.halves))])
        self._batch.reset([self._seed] * len(rows))
        while len(self.known.keys() & set(fresh)) < len(fresh):
            for e, metrics in self._batch.step(rows).metrics.items():
                self.known[tuple(rows[e].tolist())] = _last(metrics)

    def best(self) -> tuple[int, ...]:
        """Return the best plan that a search finds which begins with everyone in the west going west."""
        plan = tuple(int(name.endswith("east")) for name in self.halves)
        self.run([plan])
        for _ in range(_SWEEPS):
            flips = [tuple(exit ^ (k == flip) for k, exit in enumerate(plan)) for flip in range(len(plan))]
            self.run(flips)
            sooner = [k for k, one in enumerate(flips) if self.known[one] < self.known[plan]]
            together = tuple(exit ^ (k in sooner) for k, exit in enumerate(plan))
            self.run([together])
            best = min([plan, together, *flips], key=self.known.__getitem__)
            if best == plan:
                break
            plan = best
        return plan


def _last(metrics: object) -> float:
    time = float(metrics.evacuation_time)  # type: ignore[attr-defined]
    return time if np.isfinite(time) else np.inf


def main() -> None:
    """Print a row a draw, and the median of each column."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--scheme", default="nsm2")
    parser.add_argument("--shuts", type=float, default=60.0, help="s, when the exit in the east shuts")
    given = parser.parse_args()
    place, rows = make_scenario("building-v0", shuts=given.shuts), list[list[float]]()
    print("draw", *RULES, "hindsight", "plan", sep="\t")
    for seed in range(given.draws):
        plans = Plans(place, seed, given.scheme)
        plan = plans.best()
        rows.append([*(time_of_rule(rule, place, seed, given.scheme) for rule in RULES), plans.known[plan]])
        print(seed, *(f"{time:.1f}" for time in rows[-1]), "".join("we"[exit] for exit in plan), sep="\t", flush=True)
    print("median", *(f"{time:.1f}" for time in np.median(rows, axis=0)), sep="\t")
    gaps = np.median([row[-2] - row[-1] for row in rows])
    print(f"best rule, {RULES[-1]}, minus hindsight: {gaps:.1f} s", [*itertools.islice(plans.halves, 6)])


if __name__ == "__main__":
    main()
