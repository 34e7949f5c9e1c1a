"""What can be redone of Moussaïd et al. 2010: how companions walk, and what they look like from above."""

from crowd_env.reproduce.moussaid2010 import companies
from crowd_env.reproduce.moussaid2010.companies import MoussaidSettings
from crowd_env.reproduce.paper import Figure, Paper, every

PAPER = Paper(
    title="Moussaïd et al. 2010",
    settings=MoussaidSettings,
    figures={
        "companies": Figure(
            companies.TITLE,
            companies.reproduce,
            options=every(MoussaidSettings, "dt"),
            cpu_time=15,
        )
    },
    cpu_time=15,
)
