"""JuPedSim, its reader of recordings: python examples/clients/jupedsim_recording.py --seed 3

An evacuation is recorded in JuPedSim's trajectory format, and opened by JuPedSim.  The other way round,
`crowd_env.recording.load` opens what JuPedSim has written.
"""

import tempfile
from pathlib import Path
from typing import Annotated

import jupedsim
import numpy as np
import typer

from crowd_env import make_scenario
from crowd_env.recording import record


def evacuate(path: Path, seed: int) -> jupedsim.Recording:
    """Record 30 people who leave a room, and return the recording as JuPedSim reads it."""
    room = make_scenario("room-v0", people=30)
    return jupedsim.Recording(str(record(room, seed=seed).save(path)))


def walked(recording: jupedsim.Recording) -> dict[int, float]:
    """Return how far each agent has walked [m]: from frame to frame, as long as there is one."""
    length: dict[int, float] = {}
    before: dict[int, np.ndarray] = {}
    for k in range(recording.num_frames):
        now = {agent.id: np.array(agent.position) for agent in recording.frame(k).agents}
        for agent, place in now.items():
            length[agent] = length.get(agent, 0.0) + float(np.hypot(*(place - before.get(agent, place))))
        before = now
    return length


def main(seed: Annotated[int, typer.Option(help="Draw of the crowd.")] = 0) -> None:
    """Say what JuPedSim has read."""
    with tempfile.TemporaryDirectory() as folder:
        recording = evacuate(Path(folder) / "room.sqlite", seed)
        area, last = recording.geometry().area, (recording.num_frames - 1) / recording.fps
        print(f"{recording.num_frames} frames, {recording.fps:g} a second, until {last:.1f} s; {area:.1f} m2")
        print(f"the longest way was {max(walked(recording).values()):.1f} m")


if __name__ == "__main__":
    typer.run(main)
