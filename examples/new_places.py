"""Film one policy in places that its training never drew: python -m examples.new_places [POLICY] [FILE.gif].

Each place has a clock of its own, so that all are empty at the same moment of the film.
"""

import sys
from pathlib import Path

import numpy as np
import PIL.Image

from crowd_env import Scenario
from crowd_env.agents import make_policy
from crowd_env.agents.drivers import DrivenCrowd
from crowd_env.agents.evaluation.plans import routing_of
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics.pressure import INJURY
from crowd_env.recording import Recording, record
from crowd_env.rendering.encoding import write_gif
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.palette import BACKGROUND
from crowd_env.scenarios.generated import conditions_of, draw_place, kind_of

SHOWN = {"rooms on a corridor": "hertz", "row of rooms": "nsm2", "merging": "dem"}  # kind of place -> contact law
CELL, FPS, SECONDS, FEWEST, MOST, LONGEST = 280, 10.0, 9.0, 40, 100, 15.0  # pixels, 1/s, s, people, people, m


def places() -> dict[int, Scenario]:
    """Return the first held-out place of each kind under its law, seed -> place, whose people are large enough to see."""
    found: dict[str, int] = {}
    for seed in range(HELD_OUT_SEED, HELD_OUT_SEED + 1000):
        kind, (law, _, *hindrance) = kind_of(seed), conditions_of(seed)
        if kind not in found and SHOWN.get(kind) == law and not any(hindrance) and _fits(draw_place(seed=seed)):
            found[kind] = seed
    return {found[kind]: draw_place(seed=found[kind]) for kind in SHOWN}


def _fits(place: Scenario) -> bool:
    left, low, right, high = place.geometry.bounds
    return max(right - left, high - low) <= LONGEST and FEWEST <= place.population.people <= MOST


def walked(policy: str, seed: int, place: Scenario) -> Recording:
    """Return the evacuation of a place under a policy, with the law and the manner of its seed."""
    law, manner, *_ = conditions_of(seed)
    arguments = {"physics": law, "walking": manner, "routing": routing_of(place)}
    return record(place, seed=seed, driver=DrivenCrowd(make_policy(policy), place, arguments).settled())


def renderer_of(recording: Recording) -> Renderer:
    """Return what draws a place so that it fits into a cell."""
    left, low, right, high = recording.geometry.bounds
    width = int(CELL * min(1.0, (right - left) / (1.15 * (high - low)))) // 2 * 2
    return Renderer(recording.geometry, width=width, text=11.0, scale_bar=False)


def frame(films: list[tuple[Renderer, Recording]], share: float) -> PIL.Image.Image:
    """Return the picture of all places at a share of their times."""
    whole = PIL.Image.new("RGB", (CELL * len(films), CELL), BACKGROUND)
    for k, (renderer, recording) in enumerate(films):
        time = share * recording.end
        seen = recording.at(time)
        picture = renderer.draw(
            seen.position,
            recording.radius[seen.person],
            color_value=seen.pressure / INJURY,
            velocity=seen.velocity,
            title=recording.facts["scheme"],
            status=f"{int(recording.inside(time))} inside, {time:.0f} s",
            legend=False,
        )
        picture.thumbnail((CELL, CELL))
        whole.paste(picture, (CELL * k + (CELL - picture.width) // 2, (CELL - picture.height) // 2))
    return whole


def main(policy: str = "generalist", path: str = "new-places.gif") -> None:
    """Write the film."""
    recordings = [walked(policy, seed, place) for seed, place in places().items()]
    films = [(renderer_of(one), one) for one in recordings]
    shares = np.append(np.arange(0.0, 1.0, 1.0 / (FPS * SECONDS)), [1.0] * 8)
    step = round(100.0 / FPS) / 100.0
    write_gif(
        Path(path), (frame(films, at) for at in shares), step, [frame(films, at) for at in (0.0, 0.25, 0.5, 0.75)]
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
