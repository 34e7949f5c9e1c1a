"""How every command talks: a mistake is one line, a long wait has a bar, and an interruption says what it has left."""

import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

INTERRUPTED = 130  # exit code, as shells have it

_SIGNALS = (signal.SIGINT, signal.SIGTERM)

_MISTAKES = (ValueError, ModuleNotFoundError, OSError, MemoryError, NotImplementedError)

# A console prints texts just as they are: names of users hold brackets and colons, which are no markup and no emoji.
literal_console = partial(Console, highlight=False, markup=False, emoji=False)
notes = literal_console(stderr=True)


def say(text: str, style: str | None = None) -> None:
    """Write a line on the standard error stream just as it is, unbroken."""
    notes.print(text, style=style, soft_wrap=True)


@contextmanager
def friendly_errors(kept: str | Callable[[], str] = "") -> Iterator[None]:
    """Turn what goes wrong into one line: exit code 2 for a mistake, a missing library or a full disk, 130 for Ctrl-C.

    Warnings are notes of one line each, and SIGTERM ends the block as Ctrl-C does.

    Parameters
    ----------
    kept : what an interruption has left, in words, or a function that says it when one happens.
    """
    with _warnings_are_notes(), stops_by():
        try:
            yield
        except KeyboardInterrupt:
            interrupted(kept if isinstance(kept, str) else kept())
        except BrokenPipeError:
            raise  # the reader of our output has left: no mistake
        except (*_MISTAKES, FloatingPointError, OverflowError) as error:
            say(f"error: {_sentence(error)}", "red")
            raise typer.Exit(2) from None


def interrupted(what_is_kept: str = "") -> NoReturn:
    """Say what an interruption has left, and end with the exit code of one."""
    text = f"interrupted: {what_is_kept}" if what_is_kept else "interrupted"
    say(text, "yellow")
    raise typer.Exit(INTERRUPTED)


def _sentence(error: Exception) -> str:
    match error:
        case OSError(strerror=str() as reason, filename=str() as file):
            text = f"{file}: {reason}"
        case MemoryError():
            text = f"not enough memory: {str(error) or 'take fewer people or a smaller plan'}"
        case OverflowError():
            text = f"a number is too large: {error}"
        case _:
            text = str(error) or type(error).__name__
    return " ".join(text.split())


@contextmanager
def noted() -> Iterator[list[str]]:
    """Give the warnings of the block, a sentence each, and warn of them when it ends, also with a mistake."""
    said: list[str] = []
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", UserWarning)
            yield said
    finally:
        said += dict.fromkeys(" ".join(str(warning.message).split()) for warning in told)
        for text in said:
            warnings.warn(text, stacklevel=3)


@contextmanager
def _warnings_are_notes() -> Iterator[None]:
    """Show every warning of the block once, as a sentence without the line of code that it came from."""
    said: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        text = " ".join(str(message).split())
        if text not in said:
            said.add(text)
            say(f"note: {text}", "yellow")

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show
        yield


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@contextmanager
def stops_by(handler: Callable[[int, FrameType | None], Any] = _interrupt) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM, by which service managers and job queues end a program, call ``handler`` until the block ends.

    By default they raise KeyboardInterrupt.  Outside of the main thread, where Python handles no signals, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(number, handler) for number in _SIGNALS]
    try:
        yield
    finally:
        for number, old in zip(_SIGNALS, before, strict=True):
            signal.signal(number, old)


@contextmanager
def progress_bar(title: str, total: int = 0) -> Iterator[Callable[..., None]]:
    """Show a bar on the standard error stream while it is a terminal.

    Call what is given with each count done, and with the number of all if that was not known before.
    """
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=notes, transient=True, disable=not notes.is_terminal) as bar:
        task = bar.add_task(title, total=total)
        yield lambda count, of=None: bar.update(task, advance=count, total=of)


def check_folder(option: str, out: Path) -> None:
    """Raise ValueError, before the work instead of after it, if nothing can be written into the folder ``out``."""
    there = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists())
    if not there.is_dir():
        raise ValueError(f"{option} {out}: {there} is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ValueError(f"{option} {out}: {there} cannot be written")


def check_place(option: str, path: Path, *, makes_folder: bool = False) -> None:
    """Raise ValueError if the file ``path`` is a folder, or its folder is missing (unless that is made) or closed."""
    if path.is_dir():
        raise ValueError(f"{option} {path}: this is a folder; name a file")
    folder = path.absolute().parent
    if not makes_folder and not folder.exists():
        raise ValueError(f"{option} {path}: there is no folder {folder}")
    check_folder(option, path.parent)
