"""Draw docs/images/tasks/, where people start in each task: python -m examples.task_pictures [films] (from the checkout).

`films` are of tasks that a policy is shipped for: the rule beside what was learned, with the same people.
"""

import sys
from pathlib import Path

from crowd_env import CrowdEnv
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.side_by_side import Way, record_beside
from crowd_env.agents.tasks import TASKS
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.rendering import Renderer
from crowd_env.rendering.encoding import write_png
from crowd_env.rendering.frames import draw_env
from examples.loops import frames_of, write_loop

FOLDER = Path("docs/images/tasks")
# Task -> held-out draw that is shown: the first in which the rule blocks the exit, where it ever does.
FILMED = {"competitive-door": 2, "hertz-room": 1, "counter-flow": 0}
_WIDTH, _LONG, _FRAMES = 280, 560, 40  # px of one of two films, and where these lie below each other; frames


def draw() -> None:
    """Draw where people start."""
    for task in TASKS.values():
        env = CrowdEnv(task.place(), **task.arguments())
        env.reset([task.seeds.start])
        frame = draw_env(env, [Renderer(env.scenarios[0].geometry, width=480)])
        write_png(FOLDER / f"{task.name}.png", frame)


def film(name: str, seed: int) -> None:
    """Film the rule beside the policy of a task."""
    task = TASKS[name]
    place = task.place()
    entries = make_entries(["rule", f"{name}/ppo"], place, task)
    ways: dict[str, Way] = {
        title: (lambda where, entry=entry: entry.driver(where).settled())
        for title, entry in zip(("rule", "learned"), entries, strict=True)
    }
    films = dict(zip(ways, record_beside(ways, place, HELD_OUT_SEED + seed), strict=True))
    left, low, right, high = place.geometry.bounds
    below = right - left > 3.0 * (high - low)
    end = max(one.end for one in films.values())
    write_loop(FOLDER / f"{name}.gif", list(frames_of(films, _LONG if below else _WIDTH, end, _FRAMES, below=below)))


def main(*words: str) -> None:
    """Draw the pictures, or the films."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    if words == ("films",):
        for name, seed in FILMED.items():
            film(name, seed)
    else:
        draw()


if __name__ == "__main__":
    main(*sys.argv[1:])
