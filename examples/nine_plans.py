"""Film one policy in nine generated places that its training never drew: python examples/nine_plans.py [POLICY] [FILE.gif]."""

import sys
from pathlib import Path

import numpy as np
import PIL.Image

from crowd_env import Scenario
from crowd_env.agents import make_policy
from crowd_env.agents.drivers import DrivenCrowd, Hindrance
from crowd_env.agents.evaluation.evaluation import HELD_OUT_SEED
from crowd_env.agents.evaluation.plans import routing_of
from crowd_env.recording import Recording, record
from crowd_env.rendering.encoding import write_gif
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.palette import BACKGROUND, FULL_PRESSURE
from crowd_env.scenarios.generated import KINDS, conditions_of, draw_place, kind_of

CELL, COLUMNS, FPS, SECONDS, FEWEST, MOST = 270, 3, 10.0, 9.0, 25, 120


def places() -> dict[int, Scenario]:
    """Return the first held-out place of each kind, seed -> place, of those with enough people to see something."""
    found: dict[str, int] = {}
    for seed in range(HELD_OUT_SEED, HELD_OUT_SEED + 1000):
        if kind_of(seed) not in found and FEWEST <= draw_place(seed=seed).population.people <= MOST:
            found[kind_of(seed)] = seed
    return {found[kind]: draw_place(seed=found[kind]) for kind in KINDS}


def walked(policy: str, seed: int, place: Scenario) -> Recording:
    """Return the evacuation of a place under a policy, with the law, the manner and the noise of its seed."""
    law, manner, noise = conditions_of(seed)
    arguments = {"physics": law, "walking": manner, "routing": routing_of(place)}
    crowd = DrivenCrowd(make_policy(policy), place, arguments, hindrance=Hindrance(noise=noise))
    return record(place, seed=seed, driver=crowd.settled())


def renderer_of(recording: Recording) -> Renderer:
    """Return what draws a place so that it fits into a cell."""
    left, low, right, high = recording.geometry.bounds
    width = int(CELL * min(1.0, (right - left) / (1.15 * (high - low)))) // 2 * 2
    return Renderer(recording.geometry, width=max(width, 120), text=10.0, scale_bar=False)


def frame(films: list[tuple[Renderer, Recording, str]], time: float) -> PIL.Image.Image:
    """Return the picture of all places at a time [s]."""
    rows = -(-len(films) // COLUMNS)
    whole = PIL.Image.new("RGB", (CELL * COLUMNS, CELL * rows), BACKGROUND)
    for k, (renderer, recording, title) in enumerate(films):
        seen, inside = recording.at(time), int(recording.inside(time))
        picture = renderer.draw(
            seen.position,
            recording.radius[seen.person],
            color_value=seen.pressure / FULL_PRESSURE,
            velocity=seen.velocity,
            title=title,
            status=f"{inside} of {len(recording.radius)} inside" if inside else f"all out after {recording.end:.0f} s",
            legend=False,
        )
        picture.thumbnail((CELL, CELL))
        left, top = CELL * (k % COLUMNS), CELL * (k // COLUMNS)
        whole.paste(picture, (left + (CELL - picture.width) // 2, top + (CELL - picture.height) // 2))
    return whole


def main(policy: str = "generalist", path: str = "nine-plans.gif") -> None:
    """Write the film."""
    films = []
    for seed, place in places().items():
        recording = walked(policy, seed, place)
        films.append((renderer_of(recording), recording, f"{kind_of(seed)}, {conditions_of(seed).law}"))
    end = max(recording.end for _, recording, _ in films)
    times = np.append(np.arange(0.0, end, end / (FPS * SECONDS)), [end] * 15)
    step = round(100.0 / FPS) / 100.0
    write_gif(
        Path(path), (frame(films, time) for time in times), step, [frame(films, t) for t in np.linspace(0.0, end, 5)]
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
