"""Film one policy in places that its training never drew: python -m examples.new_places [POLICY] [FILE.gif].

Each place has a clock of its own: all are empty at the same moment of the film, rest, and begin again.
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
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.palette import BACKGROUND
from crowd_env.scenarios.generated import conditions_of, draw_place, kind_of
from examples.loops import write_loop

SHOWN = {"rooms on a corridor": "nsm2", "row of rooms": "hertz", "pillars": "nsm1"}  # kind of place -> contact law
CELL, FPS, SECONDS = 300, 10.0, 9.0  # px, 1/s, s
FEWEST, MOST, LONGEST, DRAWS = 35, 100, 10.7, 1500  # people, people, m of the longer side, held-out places to look at


def places() -> dict[int, Scenario]:
    """Return the first held-out place of each kind under its law, seed -> place, whose people are large enough to see.

    Raises
    ------
    ValueError
        If there is none of a kind, which a new version of the generated places may bring about.
    """
    found: dict[str, int] = {}
    for seed in range(HELD_OUT_SEED, HELD_OUT_SEED + DRAWS):
        kind, (law, _, *hindrance) = kind_of(seed), conditions_of(seed)
        if kind not in found and SHOWN.get(kind) == law and not any(hindrance) and _fits(draw_place(seed=seed)):
            found[kind] = seed
    if missing := SHOWN.keys() - found.keys():
        sizes = f"up to {LONGEST:g} m and {FEWEST} to {MOST} people"
        raise ValueError(
            f"no {', '.join(missing)} with {sizes} among {DRAWS} places; choose another kind or law in SHOWN"
        )
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
    write_loop(Path(path), [frame(films, at) for at in np.linspace(0.0, 1.0, round(FPS * SECONDS))], FPS)


if __name__ == "__main__":
    main(*sys.argv[1:])
