"""Granular matter, figure by figure: no paper prints these; closed forms and known laws stand beside them."""

from crowd_env.reproduce.granular import cradle, hopper, silo, stack
from crowd_env.reproduce.granular.settings import GranularSettings
from crowd_env.reproduce.paper import DRAWS, Figure, Paper

_SMALL = frozenset({"balls"})
_POURED = DRAWS | {"dt", "gravity", "friction"}

PAPER = Paper(
    title="granular matter",
    settings=GranularSettings,
    figures={
        "cradle": Figure("Newton's cradle under every scheme", cradle.reproduce, options=_SMALL, cpu_time=2),
        "stack": Figure(
            "A stack of discs at rest in a shaft", stack.reproduce, options=_SMALL | {"gravity"}, cpu_time=12
        ),
        "silo": Figure(
            "Discharge of a silo against the width of its outlet",
            silo.reproduce,
            options=_POURED | {"grains"},
            cpu_time=150,
        ),
        "hopper": Figure(
            "Arches in a hopper, with friction and without",
            hopper.reproduce,
            options=_POURED,
            defaults={"runs": hopper.DRAWS},
            cpu_time=60,
        ),
    },
    cpu_time=220,
)
