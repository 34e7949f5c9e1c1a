"""Tasks: evacuations that are fixed once and for all, so that figures of one policy stand beside those of another."""

from crowd_env.envs.tasks.task import TASKS, Task, make_task

from .presets import PRESETS, Preset, make_preset

__all__ = ["PRESETS", "TASKS", "Preset", "Task", "make_preset", "make_task"]
