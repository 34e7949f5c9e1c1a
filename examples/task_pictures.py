"""Draw docs/images/tasks/, where people start in each task: python -m examples.task_pictures (from the checkout)."""

from pathlib import Path

from crowd_env import CrowdEnv
from crowd_env.agents.tasks import TASKS
from crowd_env.rendering import Renderer
from crowd_env.rendering.encoding import write_png
from crowd_env.rendering.frames import draw_env


def main(folder: Path = Path("docs/images/tasks")) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for task in TASKS.values():
        env = CrowdEnv(task.place(), **task.arguments())
        env.reset([task.seeds.start])
        frame = draw_env(env, [Renderer(env.scenarios[0].geometry, width=480)])
        write_png(folder / f"{task.name}.png", frame)


if __name__ == "__main__":
    main()
