"""Web pages: a template of a folder, filled with texts that never become markup."""

from typing import Any

from crowd_env.core.version import __version__
from crowd_env.rendering.libraries import drawing_library


def filled(package: str, folder: str, **parts: Any) -> str:
    """Return ``template.html`` of the ``folder`` of a package with its ``parts``; every text is escaped.

    What a template includes lies in its folder, or in that of the replay.

    Raises
    ------
    ModuleNotFoundError
        If the template engine is not installed; the message explains how to install it.
    """
    with drawing_library():
        from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    where = ((package, folder), ("crowd_env.rendering.replay", "browser"))
    loader = ChoiceLoader([PackageLoader(*one) for one in where])
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    pages.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return pages.get_template("template.html").render(version=__version__, **parts)
