"""What can be redone of Helbing, Farkas, Vicsek 2000: their figure 1, in which people in a greater hurry leave later."""

from crowd_env.reproduce.helbing2000 import faster
from crowd_env.reproduce.helbing2000.faster import HelbingSettings
from crowd_env.reproduce.paper import Figure, Paper, every

PAPER = Paper(
    title="Helbing, Farkas, Vicsek 2000",
    settings=HelbingSettings,
    figures={
        "faster-is-slower": Figure(
            "Faster is slower: time in which 200 people leave a room, by the speed that they want",
            faster.reproduce,
            faster.cases,
            every(HelbingSettings),
            cpu_time=8 * 60,
        )
    },
    cpu_time=8 * 60,
)
