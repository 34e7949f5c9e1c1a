"""The command ``crowd-env schema``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.core.console import friendly_errors, notes
from crowd_env.core.files.atomic import check_suffix, write_text


def schema(out: Annotated[Path | None, typer.Option(help="File to write, .json; default: print it.")] = None) -> None:
    """Give the JSON Schema of scenario files, with which editors complete keys and mark mistakes."""
    with friendly_errors():
        from crowd_env.scenarios.schema import json_schema

        text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
        if out is None:
            typer.echo(text)
            return
        write_text(check_suffix(out, (".json",)), text + "\n")
        notes.print(f"schema: {out}", markup=False, soft_wrap=True)
