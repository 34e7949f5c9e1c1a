"""What a task does: a few numbers of its first draw, which are others where physics, ways or observation do something else.

``crowd-env freeze`` writes digests and probes of all tasks, as they are now, into ``tasks.toml``.
"""

import re

import numpy as np

from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.atomic import write_text
from crowd_env.envs.observation.layout import TERMS
from crowd_env.envs.settings import EnvArguments
from crowd_env.envs.tasks.task import FILE, TASKS, Task

# s: so few that the last bits of another processor stay small.  In 14 tasks, starts that differed by 1e-12 m made 1e-10 of each
# number by then at most, and 2e-3 in one of them (nsm2, a narrow door) after 3 s.
_SECONDS = 1.5
_WEIGHT = 0.1  # of a column, its standard deviation
_DIGITS = 8


def probe(task: Task) -> list[float]:
    """Return numbers of 1.5 s of the first held-out draw of a task, in which nobody responds late.

    They are the sum of the distances [m] of all people from (0, 0) at the start, and of those they cover by the rule.  Where a
    policy decides how people walk, also those that they cover by a fixed linear policy that sees every compiled term of the
    observation, and the sum of all that is seen last, without signs.
    """
    start, ruled, _ = _run(task, ("desired_speed",), led=False)
    found = [np.hypot(*start.T), np.hypot(*(ruled - start).T)]
    if task.decides == "walking":
        _, led, seen = _run(task, tuple(TERMS), led=True)
        found += [np.hypot(*(led - start).T), np.abs(seen, dtype=np.float64)]
    return [float(f"{one.sum():.{_DIGITS}g}") for one in found]


def _run(task: Task, terms: tuple[str, ...], *, led: bool) -> tuple[Floats, Floats, np.ndarray]:
    """Return where people begin and end (P, 2) [m], and what is observed in the end (P, D)."""
    env = CrowdEnv(task.place(), **(task.arguments() | EnvArguments(observation=ObservationLayout(terms=terms))))
    seen, _ = env.reset([task.seeds.start])
    start, layout = env.simulation.state.position.copy(), env.layout
    env.simulation.bodies.response_time[:] = 0.0  # else some crowds would stand all the time
    # Weights of a term follow from its name: another term more changes no others.  They are small: hardly anybody wants to be
    # faster than possible, so that everything counts that is seen.
    weights = [
        np.random.default_rng(list(name.encode())).normal(0.0, _WEIGHT, (layout.width(name), 2))
        for name in layout.names
    ]
    for _ in range(round(_SECONDS / env.decision_dt)):
        action = np.clip(seen @ np.concatenate(weights), -1.0, 1.0) if led else None
        seen = env.step(action).observation
    return start, env.simulation.state.position.copy(), seen


def freeze() -> None:
    """Write digest and probe of every task, as it is now, into the file of the tasks."""
    text = FILE.read_text(encoding="utf-8")
    for name, task in TASKS.items():
        told = f'frozen = "{task.digest()}"\nfrozen_learned = "{task.digest_learned()}"\nprobe = {probe(task)}\n'
        text = re.sub(
            rf"(\[{name}\]\n(?:[^\[].*\n)*?)frozen = .*\n(?:frozen_learned = .*\n)?(?:probe = .*\n)?",
            rf"\g<1>{told}",
            text,
        )
    write_text(FILE, text)
