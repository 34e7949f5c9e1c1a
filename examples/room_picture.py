"""Draw docs/images/room.png, the picture in the README: python -m examples.room_picture (from the checkout)."""

from pathlib import Path

from crowd_env.recording import record
from crowd_env.rendering import write_strip


def main(path: Path = Path("docs/images/room.png")) -> None:
    recording = record("room-v0", scheme="nsm2", seed=3)
    write_strip(path, recording, times=[0.0, 1.5, 3.0, 5.0], width=1440)


if __name__ == "__main__":
    main()
