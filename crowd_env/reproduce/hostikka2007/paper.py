"""What can be redone of Hostikka et al. 2007: an office of six storeys with one stair for all."""

from crowd_env.reproduce.hostikka2007 import office
from crowd_env.reproduce.hostikka2007.office import OfficeSettings
from crowd_env.reproduce.paper import Figure, Paper, every

PAPER = Paper(
    title="Hostikka et al. 2007",
    settings=OfficeSettings,
    figures={
        "stair-drill": Figure(
            "A stair drill: when 274 people of six storeys are out, by contact law and published speeds on stairs",
            office.reproduce,
            office.cases,
            every(OfficeSettings, "dt"),
            cpu_time=40,
        )
    },
    cpu_time=40,
)
