"""How Sphinx builds the site from these pages: `make docs`, into build/docs, without a network."""

import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import desc_annotation
from sphinx.application import Sphinx

import crowd_env

project = "crowd_env"
author = copyright = "the crowd_env authors"
version = release = crowd_env.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
root_doc = "index"
exclude_patterns = ["**.ipynb_checkpoints", "notebooks/runs"]
html_theme = "furo"
html_title = f"crowd_env {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False

# The pages are plain Markdown that code hosts show too: sections are linked by the names that they have there, quotes stay as
# typed, and formulas are text.  Links to files outside of docs/ become downloads.
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 4
smartquotes_action = "D"  # dashes alone
highlight_language = "none"

copybutton_prompt_text = "$ "
copybutton_line_continuation_character = "\\"

# Notebooks are shown with the outputs that are kept in them: tests/test_notebooks.py executes them, `make notebooks` anew.
nb_execution_mode = "off"

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
napoleon_google_docstring = False
napoleon_attr_annotations = False
napoleon_use_ivar = True
napoleon_use_param = False  # "dt, decision_dt" have one line together
add_module_names = False
default_role = "py:obj"  # `CrowdEnv` in a docstring is a link where that is on a page

# What `NDArray[np.float64]` is spelled out as, in the text of a signature and in what it looks like in the end.
ARRAY = re.compile(r"~numpy\.ndarray\[tuple\[~typing\.Any, \.\.\.\], ~numpy\.dtype\[~numpy\.(\w+)\]\]")
SHORT_ARRAY = re.compile(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(\w+)\]\]")


def shorten(app: Sphinx, what: str, name: str, thing: object, options: Any, signature: str, returns: str) -> Any:
    """Show arrays among parameters as the source does, and what a dataclass makes by itself as something that can be parsed."""
    return tuple(text and ARRAY.sub(r"NDArray[\1]", text).replace("<factory>", "...") for text in (signature, returns))


def shorten_attributes(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Show arrays among attributes as the source does."""
    for node in doctree.findall(desc_annotation):
        if SHORT_ARRAY.search(node.astext()):
            node.children = [nodes.Text(SHORT_ARRAY.sub(r"NDArray[\1]", node.astext()))]


def read_as_meant(app: Sphinx, what: str, name: str, thing: object, options: Any, lines: list[str]) -> None:
    """Let registries say what they hold; move "name : what it is" to where Napoleon expects it, which takes it for a type."""
    if isinstance(thing, dict):  # has no docstring but that of dict
        lines[:] = ["Names: " + ", ".join(f"``{key}``" for key in thing) + ".", ""]
    if lines and what in ("attribute", "data", "property"):
        lines[0] = ": " + lines[0]  # here Napoleon takes what stands before the first colon for the type
        return
    section = ""
    changed: list[str] = []
    for k, line in enumerate(lines):
        if k + 1 < len(lines) and line and set(lines[k + 1]) == {"-"}:
            section = line
        described = re.match(r"([*\w, ]+) : (.+)", line)
        if section in ("Parameters", "Attributes") and described:
            changed += [described[1].replace("*", ""), f"    {described[2]}"]
        else:
            changed.append(line)
    lines[:] = changed


def name_pages(app: Sphinx, page: str, source: list[str]) -> None:
    """A link that is called by its file, as code hosts want it, is called by the title of where it leads."""
    source[0] = re.sub(r"\[[\w/-]+\.md\](?=\([\w./-]+\.md)", "[]", source[0])


def setup(app: Sphinx) -> None:
    app.connect("source-read", name_pages)
    app.connect("autodoc-process-signature", shorten)
    app.connect("doctree-resolved", shorten_attributes)
    app.connect("autodoc-process-docstring", read_as_meant, priority=400)  # before Napoleon, which has 500
