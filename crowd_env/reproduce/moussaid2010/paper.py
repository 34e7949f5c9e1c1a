"""What can be redone of Moussaïd et al. 2010: how groups walk, and what they look like from above."""

from crowd_env.reproduce.moussaid2010 import groups
from crowd_env.reproduce.moussaid2010.groups import MoussaidSettings
from crowd_env.reproduce.paper import Figure, Paper, every

PAPER = Paper(
    title="Moussaïd et al. 2010",
    settings=MoussaidSettings,
    figures={
        "groups": Figure(
            "Figures 2 and 4: walking speed, spacing and shape of groups by their size",
            groups.reproduce,
            options=every(MoussaidSettings, "dt"),
            cpu_time=15,
        )
    },
    cpu_time=15,
)
