"""Tasks: evacuations that are fixed once and for all, so that figures of one policy stand beside those of another."""

from .presets import PRESETS, Preset, make_preset
from .task import TASKS, Task, make_task

__all__ = ["PRESETS", "TASKS", "Preset", "Task", "make_preset", "make_task"]
