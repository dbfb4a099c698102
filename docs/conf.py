"""How Sphinx makes the site: ``make docs``. Nothing that it writes is loaded from another server."""

from __future__ import annotations

import inspect
import re
import sys
from dataclasses import is_dataclass
from importlib.metadata import version as version_of
from pathlib import Path
from typing import TYPE_CHECKING, Any

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "boltlaw"
author = copyright = "boltlaw maintainers"
version = release = version_of("boltlaw")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["html_image"]  # pictures in HTML are copied to the site too
myst_heading_anchors = 4  # links to headings as in a repository's pages
exclude_patterns = ["_build", "notebooks"]
default_role = "code"
smartquotes = False  # x'' is a derivative
nitpicky = False  # types in docstrings are words as often as names
autodoc_typehints = "none"  # numpydoc says types and units
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_preserve_defaults = True  # by name, not by value: criteria are long
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"  # light and dark, for phones too; fonts are those of the system
html_title = f"boltlaw {version}"
html_static_path, html_css_files = ["_static"], ["scroll.css"]
html_copy_source = html_show_sourcelink = False
html_permalinks_icon = "#"

ROOT_PAGES = {"index": "README.md", "contributing": "CONTRIBUTING.md", "changelog": "CHANGELOG.md"}
"""Pages whose text is a file of the repository's root; what the page itself holds follows it."""


def setup(app: Sphinx) -> None:
    """Have Sphinx call what completes the text of pages and shortens signatures."""
    app.connect("source-read", complete)
    app.connect("autodoc-process-signature", short_defaults)


def complete(_app: Sphinx, page: str, source: list[str]) -> None:
    """Put the root's files into their pages, and what notebooks printed below the blocks of theirs."""
    from tests.documents.notebooks import with_outputs

    text = with_outputs(DOCS / f"{page}.md", source[0]) if (DOCS / f"{page}.md").exists() else source[0]
    if page in ROOT_PAGES:
        text = (DOCS.parent / ROOT_PAGES[page]).read_text(encoding="utf-8") + "\n" + text.partition("\n")[2]
    if page == "blind/tables":  # its headings are below that of the page that it belongs to
        text = "# Tables of the blind test\n\n" + text
    text = re.sub(r"\]\((?:\.\./)?README\.md", "](index.md", text)
    text = text.replace("[notebooks](docs/notebooks)", "notebooks")  # each page has a link to its own
    for name in ("CONTRIBUTING", "CHANGELOG"):
        text = re.sub(rf"\]\((?:\.\./)?{name}\.md", f"]({name.lower()}.md", text)
    source[0] = text.replace("](docs/", "](").replace('src="docs/', 'src="')


def short_defaults(
    _app: Sphinx, _what: str, _name: str, member: object, _options: object, signature: str, returns: str
) -> tuple[str, str]:
    """Name the class of a dataclass's default instead of all its fields: those of criteria fill a screen."""
    if not (isinstance(member, type) and is_dataclass(member)):
        return signature, returns
    told = inspect.signature(member)
    fields = [
        field.replace(annotation=field.empty, default=ByName(field.default))
        if is_dataclass(field.default)
        else field.replace(annotation=field.empty)
        for field in told.parameters.values()
    ]
    return str(told.replace(parameters=fields, return_annotation=told.empty)), returns


class ByName:
    """A default that is shown as a call of its class."""

    def __init__(self, default: Any) -> None:
        self.shown = f"{type(default).__name__}()"

    def __repr__(self) -> str:
        return self.shown
