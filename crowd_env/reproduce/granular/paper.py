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
        "cradle": Figure(cradle.TITLE, cradle.reproduce, options=_SMALL, cpu_time=2),
        "stack": Figure(stack.TITLE, stack.reproduce, options=_SMALL | {"gravity"}, cpu_time=12),
        "silo": Figure(silo.TITLE, silo.reproduce, options=_POURED | {"grains"}, cpu_time=150),
        "hopper": Figure(hopper.TITLE, hopper.reproduce, options=_POURED, defaults={"runs": hopper.DRAWS}, cpu_time=60),
    },
    cpu_time=220,
)
