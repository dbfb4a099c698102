"""CITATION.cff, codemeta.json, the conda recipe and the paper say what pyproject.toml says."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import yaml

REPOSITORY = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]
CITATION_KEYS = {
    "cff-version", "message", "title", "authors", "type", "version", "license", "keywords", "abstract",
    "references", "date-released", "doi", "identifiers", "url", "repository-code", "contact",
}  # fmt: skip
"""Those of the schema 1.2.0 that this file may use; the schema refuses any other."""
PERSON, ENTITY = {"family-names", "given-names", "orcid", "affiliation"}, {"name"}


def conda_name(requirement: str) -> str:
    """A requirement as conda writes it: a space before the bound; matplotlib without its windows."""
    name, bound = re.fullmatch(r"([\w-]+)(.*)", requirement).groups()  # type: ignore[union-attr]
    return f"{'matplotlib-base' if name == 'matplotlib' else name} {bound}"


def test_the_citation_file_is_one() -> None:
    """Required keys, known keys, and persons or entities as the schema of CFF 1.2.0 has them."""
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(citation) <= CITATION_KEYS
    assert citation["cff-version"] == "1.2.0"
    assert citation["type"] == "software"
    for work in (citation, *citation["references"]):
        assert {"title", "authors", "type"} <= set(work)
        assert all(set(author) <= PERSON or set(author) == ENTITY for author in work["authors"])
    assert str(citation["version"]) == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert citation["authors"] == PROJECT["authors"]
    assert set(citation["keywords"]) <= set(PROJECT["keywords"])


def test_codemeta_is_that_of_the_project() -> None:
    meta = json.loads((REPOSITORY / "codemeta.json").read_text(encoding="utf-8"))
    assert meta["@context"].startswith("https://doi.org/10.5063/schema/codemeta")
    assert [meta[key] for key in ("name", "version", "description")] == [
        PROJECT[key] for key in ("name", "version", "description")
    ]
    assert meta["license"].endswith(f"/{PROJECT['license']}")
    assert meta["softwareRequirements"] == [re.split("[=>]", one)[0] for one in PROJECT["dependencies"]]
    assert [{"name": author["name"]} for author in meta["author"]] == PROJECT["authors"]


def test_the_recipe_asks_for_what_the_project_asks_for() -> None:
    text = (REPOSITORY / "recipe" / "meta.yaml").read_text(encoding="utf-8")
    version = re.search(r'set version = "(.*)"', text)
    assert version is not None
    plain = re.sub(r"{%.*%}", "", text).replace("{{ version }}", version[1]).replace("{{ PYTHON }}", "python")
    recipe = yaml.safe_load(plain)
    assert (recipe["package"]["name"], str(recipe["package"]["version"])) == (
        PROJECT["name"],
        PROJECT["version"],
    )
    python, *needs = recipe["requirements"]["run"]
    assert python == f"python {PROJECT['requires-python']}"
    assert needs == [conda_name(one) for one in PROJECT["dependencies"]]
    assert recipe["build"]["entry_points"] == [f"boltlaw = {PROJECT['scripts']['boltlaw']}"]


def test_the_paper_cites_what_its_bibliography_has() -> None:
    text = (REPOSITORY / "paper" / "paper.md").read_text(encoding="utf-8")
    entries = re.findall(r"@\w+\{(\w+),", (REPOSITORY / "paper" / "paper.bib").read_text(encoding="utf-8"))
    _, head, body = text.split("---\n", 2)
    assert set(re.findall(r"@(\w+)", body)) == set(entries)
    assert len(entries) == len(set(entries))
    front = yaml.safe_load(head)
    assert front["bibliography"] == "paper.bib"
    assert [author["name"] for author in front["authors"]] == [one["name"] for one in PROJECT["authors"]]
    headings = re.findall(r"^# (.+)$", body, re.MULTILINE)
    assert headings == [
        "Summary", "Statement of need", "State of the field", "Software design", "Research impact statement",
        "References",
    ]  # fmt: skip
    assert 750 <= len(body.split()) <= 1750  # the range that the journal asks for
