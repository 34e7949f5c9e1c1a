"""The page: a template with a style sheet, our own script and the project, one file that needs nothing else."""

from pathlib import Path
from typing import Any

from crowd_env.core.behaviors.headway import MANNERS
from crowd_env.core.checks import Plain
from crowd_env.rendering.pages import filled
from crowd_env.rendering.replay.page import style_variables
from crowd_env.scenarios.profiles import PROFILES


def editor_page(content: Plain, path: Path, *, served: bool, shown: Plain | None = None, **more: Any) -> str:
    """Return a page that edits a project.

    Parameters
    ----------
    content : of the project.
    path : where it is saved.
    served : whether a server checks, saves and runs it; a page alone hands back a file.
    shown : what is understood of the project; a served page asks for it.
    more : of a served page: the content that is saved, the revision of the file, whether there is a run.

    Raises
    ------
    ModuleNotFoundError
        If the template engine is not installed; the message explains how to install it.
    """
    about = {
        "content": content,
        "file": path.name,
        "served": served,
        "shown": shown,
        "saved": content,
        **more,
        "profiles": [[name, f"{name}: {one.people}"] for name, one in PROFILES.items()],
        "walking": list(MANNERS),
    }
    return filled("crowd_env.rendering.editor", "browser", about=about, title=path.name, style=style_variables())
