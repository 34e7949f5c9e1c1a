"""What can be made of the crowd on a footbridge."""

from crowd_env.reproduce.footbridge import deck, gate, onset, rival
from crowd_env.reproduce.footbridge.settings import FootbridgeSettings
from crowd_env.reproduce.paper import Figure, Paper, every

_ALL = every(FootbridgeSettings)

PAPER = Paper(
    title="the footbridge, Strogatz et al. 2005 and Belykh et al. 2021",
    settings=FootbridgeSettings,
    figures={
        "bridge-onset": Figure(
            "Footbridge: amplitude and order of steps against the number of walkers",
            onset.reproduce,
            None,
            _ALL - {"people"},
            cpu_time=240,
        ),
        "bridge-rival": Figure(
            "Footbridge: which starts the sway, steps in time (synchrony) or balance (pendulum)",
            rival.reproduce,
            None,
            frozenset({"seed", "duration"}),
            cpu_time=10,
        ),
        "bridge-gate": Figure(
            "Footbridge: rules that hold people back at the entrance",
            gate.reproduce,
            None,
            _ALL,
            {"people": gate.PEOPLE},
            cpu_time=180,
        ),
        "bridge-deck": Figure(
            "Footbridge: one crowd on the deck, traces and film", deck.reproduce, None, _ALL - {"runs"}, cpu_time=40
        ),
    },
    cpu_time=470,
)
