"""How the house is measured: tokens of rooms, arrows and circles between modules, words of prose, files of a behaviour."""

import ast
import inspect
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import grimp
import typer
from repository import ROOT

import crowd_env
from crowd_env.cli.main import app

PRODUCTION = ("crowd_env", "agents", "validation", "benchmarks", "train.py")
_NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}

# Behaviour -> what names it, as whole words, whatever the case; and what is left out because it means another thing: the edge
# of a floor plan or of an obstacle, a line around what is drawn, to draw back.
BEHAVIOURS = {
    "manner": (r"manners?|headways?", None),
    "pulls": (r"pulls?|cohesion|group_size", r"pulls? (?:at|back|on|out)\b"),
    "outline": (
        r"outlines?",
        r"(?:an|its|whose) outline (?:and|lies|touches)|outlines? (?:lies|of the floor|that)|away from its outline"
        r"|bar\.outline|import Path as Outline|Outline\.make\w*|PathPatch\(outline"
        r"|outline = (?:\[|Outline)|column_stack\(outline",
    ),
    "max_drive": (r"max_drive", None),
    "balance": (r"balances?", None),
}

# Words that a technical writer would replace, in docstrings, comments and messages of errors.
WORDS = {
    "who, whose, whom": r"who|whose|whom",
    "those": r"those",
    "nobody, whoever": r"nobody|whoever",
    "the own": r"the own",
    "so many": r"so many",
    "anew": r"anew",
    "told, said, says": r"told|said|says",
    "the found": r"(?:the|is|what is|are|all) found",
    "oneself, one's own": r"oneself|one's own",
}


def sources(*folders: str) -> list[Path]:
    """Return the files of folders; those of agents/ once, though crowd_env links to them."""
    paths = [
        path for name in folders for path in ([ROOT / name] if name.endswith(".py") else (ROOT / name).rglob("*.py"))
    ]
    return sorted(path for path in paths if path.relative_to(ROOT).parts[:2] != ("crowd_env", "agents"))


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def docstrings(source: str) -> Iterator[ast.Constant]:
    """Yield every text that stands alone, as docstrings do."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value


def tokens_of(source: str) -> int:
    """Return how many tokens of a source are code: no docstring, comment, line end or indentation."""
    texts = {line for node in docstrings(source) for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return sum(token.type not in _NO_CODE and token.start[0] not in texts for token in tokens)


def tokens_of_rooms() -> dict[str, int]:
    """Return room -> tokens, of everything but tests, examples and docs."""
    found: Counter[str] = Counter()
    for path in sources(*PRODUCTION):
        first, *rest = path.relative_to(ROOT).parts
        within = rest[0] if first == "crowd_env" and len(rest) > 1 else ""
        found[f"{first}/{within}".rstrip("/")] += tokens_of(text_of(path))
    return dict(found)


# ------------------------------------------------------------------------------------------------------------- arrows


@cache
def graph() -> Any:
    return grimp.build_graph("crowd_env", "validation", "benchmarks", cache_dir=None)


def circles(uses: dict[str, set[str]]) -> list[list[str]]:
    """Return the largest sets of two or more that all reach each other."""
    reached: dict[str, set[str]] = {}
    for start in uses:
        seen, open_ends = set[str](), [start]
        while open_ends:
            new = uses.get(open_ends.pop(), set()) - seen
            seen |= new
            open_ends += new
        reached[start] = seen
    found = {tuple(sorted(b for b in reached[a] if a in reached.get(b, ()))) for a in uses if a in reached[a]}
    return [list(one) for one in sorted(found) if len(one) > 1]


def arrows() -> dict[str, set[str]]:
    """Return module -> modules that it imports, wherever in the file."""
    return {module: graph().find_modules_directly_imported_by(module) for module in graph().modules}


def late_imports() -> set[tuple[str, str]]:
    """Return importer and imported of every import of an own module that is not at the top of its file."""
    found = set()
    for importer, used in arrows().items():
        for imported in used:
            details = graph().get_import_details(importer=importer, imported=imported)
            path = ROOT / (importer.replace(".", "/"))
            lines = text_of(path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).splitlines()
            if all(lines[detail["line_number"] - 1][:1].isspace() for detail in details):
                found.add((importer, imported))
    return found


def rooms() -> dict[str, set[str]]:
    """Return room -> rooms that it imports from; train.py is the one above all.

    Left out are the looks up of what can be drawn, which loads the drawing when it is drawn, as in the contract of the layers.
    """

    def room(module: str) -> str:
        package, *parts = module.split(".")
        return package if package != "crowd_env" or not parts else parts[0]

    drawn = {pair for pair in late_imports() if room(pair[0]) in {"envs"} and room(pair[1]) == "rendering"}
    found: dict[str, set[str]] = {"train": {"cli"}}
    for module, used in arrows().items():
        names = {room(other) for other in used if (module, other) not in drawn}
        found.setdefault(room(module), set()).update(names - {room(module)})
    return found


def floors(uses: dict[str, set[str]]) -> Iterator[set[str]]:
    """Yield the rooms floor by floor, from the ground up; a circle is an error."""
    left = dict(uses)
    while left:
        floor = {name for name, used in left.items() if not used & set(left)}
        assert floor, f"rooms that use each other in a circle are among {sorted(left)}"
        yield floor
        left = {name: used for name, used in left.items() if name not in floor}


# -------------------------------------------------------------------------------------------------------------- prose


def prose_of(source: str) -> str:
    """Return docstrings, comments and messages of errors."""
    texts = [node.value for node in docstrings(source)]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Raise):
            texts += [
                part.value for part in ast.walk(node) if isinstance(part, ast.Constant) and isinstance(part.value, str)
            ]
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return "\n".join([*map(str, texts), *(token.string for token in tokens if token.type == tokenize.COMMENT)])


def words_of_prose() -> dict[str, int]:
    """Return word -> how often it stands in production code."""
    prose = re.sub(r"[\s#]+", " ", " ".join(prose_of(text_of(path)) for path in sources(*PRODUCTION)))
    return {word: len(re.findall(rf"\b(?:{said})\b", prose, re.IGNORECASE)) for word, said in WORDS.items()}


def sentences_of(docstring: str) -> Iterator[list[str]]:
    """Yield the words of each sentence; examples, underlines and what is set apart, such as equations, are none."""
    for paragraph in re.split(r"\n\s*\n", inspect.cleandoc(docstring)):
        lines = [line.strip() for line in paragraph.splitlines()]
        if paragraph[:1].isspace() or any(line.startswith((">>>", "|", "---")) for line in lines[:2]):
            lines = [line for line in lines[2:] if not line.startswith((">>>", "|"))]
        for sentence in re.split(r"(?<=[.!?])\s+|\n(?=\w+(?:, \w+)* : )", "\n".join(lines)):
            if words := sentence.split():
                yield words


def share_of_long_sentences(most: int = 20) -> float:
    """Return the share [%] of sentences in docstrings that have more than ``most`` words."""
    found = [
        len(words)
        for path in sources(*PRODUCTION)
        for node in docstrings(text_of(path))
        for words in sentences_of(str(node.value))
    ]
    return 100 * sum(length > most for length in found) / len(found)


def words_of_docs() -> int:
    """Return the words of the pages, without the tables that programs write."""
    written = re.compile(r"<!-- table: .*?-->.*?<!-- end -->", re.DOTALL)
    return sum(len(written.sub("", text_of(path)).split()) for path in (ROOT / "docs").rglob("*.md"))


# ----------------------------------------------------------------------------------------------------------- names


def files_naming(behaviour: str) -> int:
    """Return how many files of production name a behaviour, in code or in prose."""
    named, otherwise = BEHAVIOURS[behaviour]
    texts = [text_of(path) for path in sources("crowd_env", "agents", "validation", "benchmarks")]
    if otherwise is not None:
        texts = [re.sub(otherwise, " ", text, flags=re.IGNORECASE) for text in texts]
    return sum(bool(re.search(rf"\b(?:{named})\b", text, re.IGNORECASE)) for text in texts)


def names_in(folder: str, name: str) -> int:
    """Return how often a name stands in the code of a folder."""
    found = 0
    for path in sources(folder):
        tokens = tokenize.generate_tokens(io.StringIO(text_of(path)).readline)
        found += sum(token.type == tokenize.NAME and token.string == name for token in tokens)
    return found


def arguments_of(called: Any) -> int:
    return len(inspect.signature(called).parameters)


def options() -> dict[str, int]:
    """Return command -> number of its options and arguments, beside --help."""
    group = typer.main.get_command(app)
    context = typer.Context(group)
    commands = {name: group.get_command(context, name) for name in group.list_commands(context)}
    return {name: sum("--help" not in option.opts for option in command.params) for name, command in commands.items()}


def everything() -> dict[str, int]:
    """Return everything that has a ceiling, by its name in the table."""
    uses, asked, tokens, late, loops = rooms(), options(), tokens_of_rooms(), late_imports(), circles(arrows())
    return {
        **{f"tokens of {room}": count for room, count in sorted(tokens.items())},
        "tokens of all": sum(tokens.values()),
        "rooms": len(uses),
        "floors": len(list(floors(uses))),
        "arrows between rooms": sum(map(len, uses.values())),
        "circles of modules": len(loops),
        "late imports that hide a circle": sum(any({*pair} <= {*loop} for loop in loops) for pair in late),
        "late imports": len(late),
        "Any in agents": names_in("agents", "Any"),
        **{f"files that name {behaviour}": files_naming(behaviour) for behaviour in BEHAVIOURS},
        "arguments of CrowdEnv": arguments_of(crowd_env.CrowdEnv),
        "arguments of parallel_env": arguments_of(crowd_env.parallel_env),
        "arguments of make_vec": arguments_of(crowd_env.make_vec),
        "arguments of Simulation": arguments_of(crowd_env.Simulation),
        "options of run": asked["run"],
        "options of any command": max(asked.values()),
        "words of docs": words_of_docs(),
        "per cent of sentences above 20 words": round(share_of_long_sentences()),
        **{f"words in prose: {word}": count for word, count in words_of_prose().items()},
    }
