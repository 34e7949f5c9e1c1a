"""Options of the command line, made from the settings of papers."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer

from crowd_env.reproduce import Paper
from crowd_env.reproduce.settings import Settings, flag


def takes_settings(papers: Mapping[str, Paper[Any]]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that gives a command one option a setting, None by default, in place of its ``**options``."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        parameters = list(inspect.signature(command).parameters.values())[:-1]
        for name in dict.fromkeys(one.name for paper in papers.values() for one in fields(paper.settings)):
            annotation = _annotation(name, [paper for paper in papers.values() if hasattr(paper.settings, name)])
            parameters.append(
                inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            )
        setattr(command, "__signature__", inspect.Signature(parameters))  # noqa: B010  # mypy knows no such attribute
        return command

    return decorate


def _annotation(name: str, papers: list[Paper[Any]]) -> Any:
    """Return the type and the explanation of an option of ``papers``; one paper alone heads a section of the help."""
    kind = _kind(papers[0].settings, name)
    switch = [flag(name)] if kind is bool else []
    panel = papers[0].title if len(papers) == 1 else None
    return Annotated[kind | None, typer.Option(*switch, help=_help(name, papers), rich_help_panel=panel)]


def _kind(settings: type[Settings], name: str) -> Any:
    """Return the type of the option; a word is read as any text, because the settings themselves name the known ones."""
    hint = get_type_hints(settings)[name]
    if get_origin(hint) is Literal:
        return str
    return next((kind for kind in get_args(hint) if kind is not type(None)), hint)


def _help(name: str, papers: list[Paper[Any]]) -> str:
    """Return what an option means and its default, each once if they are the same in all papers."""
    meanings = {
        paper.title: one.metadata["help"] for paper in papers for one in fields(paper.settings) if one.name == name
    }
    defaults = {paper.title: _defaults(name, paper) for paper in papers}
    if len(set(meanings.values())) > 1:
        return "; ".join(f"{title}: {text}{defaults[title]}" for title, text in meanings.items()) + "."
    if len(set(defaults.values())) == 1:
        return f"{meanings[papers[0].title]}{defaults[papers[0].title]}."
    return meanings[papers[0].title] + "".join(f"{text} ({title})" for title, text in defaults.items()) + "."


def _defaults(name: str, paper: Paper[Any]) -> str:
    """Return "; default 50, of table7 100"."""
    default = getattr(paper.settings, name)
    if default is None or default is False:
        return ""
    others = {key: figure.defaults[name] for key, figure in paper.figures.items() if name in figure.defaults}
    return f"; default {_plain(default)}" + "".join(f", of {key} {_plain(value)}" for key, value in others.items())


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
