"""Draw docs/images/room.png, the picture in the README: python -m examples.room_picture (from the checkout)."""

from pathlib import Path

from crowd_env import make_scenario
from crowd_env.rendering import write_strip
from crowd_env.rendering.live import record


def main(path: Path = Path("docs/images/room.png")) -> None:
    recording = record(make_scenario("room-v0"), scheme="nsm2", seed=3)
    write_strip(path, recording, times=[0.0, 1.5, 3.0, 5.0], width=1440)


if __name__ == "__main__":
    main()
