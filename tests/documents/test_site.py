"""The site: whole, without broken links, and nothing in it is loaded from another server."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.documents.blocks import REPOSITORY
from tests.documents.notebooks import NOTEBOOKS
from tests.shared import Shared

DOCS = REPOSITORY / "docs"
LOADS = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href", "object": "data"}
"""Attributes by which a page loads something when it is shown; a link that is followed is none."""


class Loads(HTMLParser):
    """What a page loads, and where its links lead."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: set[str] = set()
        self.links: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.loaded |= {given[LOADS[tag]] or ""} if LOADS.get(tag) in given else set()
        self.links |= {given["href"] or ""} if tag == "a" and "href" in given else set()


def elsewhere(text: str) -> list[str]:
    return sorted(one for one in Loads(text).loaded if re.match(r"(\w+:)?//", one))


@pytest.fixture(scope="session")
def site(shared: Shared) -> Path:
    """The built site: as `make docs` builds it, where any warning is an error."""

    def work() -> Path:
        target = shared.new_folder()
        options = ["--quiet", "--fail-on-warning", "--keep-going", str(DOCS), str(target)]
        ran = subprocess.run(
            [sys.executable, "-m", "sphinx", *options],
            cwd=REPOSITORY, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert ran.returncode == 0, ran.stderr
        return target

    return shared.once("site", work)


def test_nothing_is_loaded_from_another_server(site: Path) -> None:
    found = {page.name: elsewhere(page.read_text(encoding="utf-8")) for page in site.rglob("*.html")}
    assert len(found) > 30
    assert {name: loads for name, loads in found.items() if loads} == {}
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.search(r"""(?:@import\s*|url\(\s*)["']?(?:https?:)?//""", text), style.name


def test_a_load_from_another_server_is_noticed() -> None:
    page = '<script src="https://cdn.example/a.js"></script><a href="https://example.org">b</a>'
    assert elsewhere(f'{page}<link href="//fonts.example"><img src="c.svg">') == [
        "//fonts.example",
        "https://cdn.example/a.js",
    ]


def test_every_page_is_in_the_navigation_and_the_search(site: Path) -> None:
    links = Loads((site / "index.html").read_text(encoding="utf-8")).links
    pages = {f"{path.stem}.html" for path in DOCS.glob("*.md")} - {"index.html"} | {"api.html"}
    assert pages <= links
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert all(f'"{Path(page).stem}"' in index for page in pages)
    assert "read_campaign" in index
    assert "searchindex.js" in (site / "search.html").read_text(encoding="utf-8")


def test_a_page_can_be_searched_from_and_is_dark_where_a_reader_wants_it(site: Path) -> None:
    page = (site / "index.html").read_text(encoding="utf-8")
    assert 'action="search.html"' in page
    assert 'class="theme-toggle"' in page
    styles = [site / one.partition("?")[0] for one in Loads(page).loaded if ".css" in one]
    (theme,) = (style for style in styles if style.name == "furo.css")
    assert re.search(r"prefers-color-scheme:\s*dark", theme.read_text(encoding="utf-8"))


def test_public_names_are_explained_and_pictures_shown(site: Path) -> None:
    import discovery
    import rom

    api = (site / "api.html").read_text(encoding="utf-8")
    names = [f"rom.{one}" for one in rom.__all__] + [f"discovery.{one}" for one in discovery.__all__]
    assert [one for one in names if f'id="{one}"' not in api] == []
    signatures = re.findall(r'<dt class="sig .*?</dt>', api, flags=re.DOTALL)
    assert len(signatures) > len(names)
    assert max(len(re.sub("<[^>]+>", "", one)) for one in signatures) < 600  # no default fills a screen
    gallery = (site / "gallery.html").read_text(encoding="utf-8")
    assert [one.name for one in (DOCS / "images").iterdir() if f"_images/{one.name}" not in gallery] == []


def test_wide_tables_and_blocks_scroll_and_show_it(site: Path) -> None:
    """A phone has no scroll bars: what is cut without a shadow looks as if it ended there."""
    for page in ("index.html", "blind/tables.html"):
        styles = Loads((site / page).read_text(encoding="utf-8")).loaded
        (style,) = (one.partition("?")[0] for one in styles if "scroll.css" in one)
        (rule,) = re.findall(
            r"\.table-wrapper\.container,\s*\.highlight pre \{(.*?)\}",
            (site / page).parent.joinpath(style).read_text(),
            re.DOTALL,
        )
        assert "overflow-x: auto" in rule
        assert rule.count("no-repeat scroll") == 2


def test_notebooks_can_be_taken_from_their_pages(site: Path) -> None:
    for name, page in NOTEBOOKS.items():
        text = (site / page.replace(".md", ".html")).read_text(encoding="utf-8")
        (link,) = (one for one in Loads(text).links if one.endswith(f"{name}.ipynb"))
        assert (site / link).is_file()
