"""The tasks, by name: what ``tasks.toml`` says of them.

No task changes but with its version: `Task.digest` sums up everything that a task comes to, defaults of the package included,
and a test compares it with what is ``frozen`` there.  Where a default has changed, write the old value into the task.  Where
that cannot be, raise the version and freeze the new digest: figures of two versions do not stand in one table.
"""

from pathlib import Path

import tomllib

from crowd_env.core.checks import known

from .task import Task

# Name -> task.
TASKS: dict[str, Task] = {
    name: Task(name, **facts)
    for name, facts in tomllib.loads(Path(__file__).with_name("tasks.toml").read_text(encoding="utf-8")).items()
}


def make_task(name: str) -> Task:
    """Return the task of a name in `TASKS`.

    Raises
    ------
    ValueError
        If it is unknown; the message lists the known ones.
    """
    return TASKS[known("task", name, TASKS)]
