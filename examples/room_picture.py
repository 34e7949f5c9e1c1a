"""Draw docs/images/room.png, the picture in the README: python -m examples.room_picture (from the checkout)."""

from pathlib import Path

from crowd_env import CrowdEnv
from crowd_env.rendering import write_strip
from crowd_env.rendering.live import Recorder


def main(path: Path = Path("docs/images/room.png")) -> None:
    env = CrowdEnv("room-v0", scheme="nsm2")
    env.reset([3])
    recorder = Recorder(env)
    recorder.snap()
    while not env.finished.all():
        env.step(None)
        recorder.snap()
    write_strip(path, recorder.recording(), times=[0.0, 1.5, 3.0, 5.0], width=1440)


if __name__ == "__main__":
    main()
