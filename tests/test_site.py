"""The documentation's site, opened from the disk: a few pages, built with the settings of all of them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from bs4 import BeautifulSoup
from playwright.sync_api import Browser

from scripts import site_notebooks
from scripts.glossary_links import TERMS, anchor, with_links


ROOT = Path(__file__).parents[1]
PAGES = ("glossary.md", "funnel.md")  # which need nothing from the package
BUILD = """
import sys
from mkdocs.commands.build import build
from mkdocs.config import load_config
docs, site, *pages = sys.argv[1:]
build(load_config("mkdocs.yml", docs_dir=docs, site_dir=site, nav=pages))
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    docs, site = tmp_path_factory.mktemp("docs"), tmp_path_factory.mktemp("site")
    for name in (*PAGES, "site.css", "javascripts", "images"):
        (docs / name).symlink_to(ROOT / "docs" / name)
    subprocess.run([sys.executable, "-c", BUILD, docs, site, *PAGES], cwd=ROOT, check=True, capture_output=True)
    return site


def test_the_search_box_works_from_the_disk(site: Path, browser: Browser) -> None:
    page = browser.new_page()
    page.goto((site / "glossary.html").as_uri())
    page.type("input[name=query]", "funnel")
    page.wait_for_selector("a.md-search-result__link[href*='funnel.html']")
    page.type("input[name=query]", "xylophone")
    page.wait_for_selector("text=No matching documents")
    page.close()


def test_the_first_appearance_of_a_term_leads_to_the_glossary(site: Path) -> None:
    links = BeautifulSoup((site / "funnel.html").read_text(), "html.parser").select("a.term")
    assert {"I", "G", "S", "margin"} <= {link.get_text() for link in links}
    rows = {row["id"] for row in BeautifulSoup((site / "glossary.html").read_text(), "html.parser").select("tr[id]")}
    assert set(map(anchor, TERMS.values())) <= rows
    assert {link["href"] for link in links} <= {f"glossary.html#{row}" for row in rows}


def test_notebooks_that_are_there_are_downloads(site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scripts = {script.stem for script in site_notebooks.FOLDER.glob("*.py")}
    listed = BeautifulSoup((site / "notebooks.html").read_text(), "html.parser").select("tbody tr td:first-child")
    assert scripts <= {cell.get_text().removesuffix(".ipynb") for cell in listed}
    assert {file.name for file in site.glob("notebooks/*")} == {
        file.name for file in site_notebooks.FOLDER.glob("*.ipynb")
    }
    monkeypatch.setattr(site_notebooks, "FOLDER", tmp_path)
    table = "| `controller` | drives |\n| `own_path` | bends |\n"
    assert site_notebooks.page(table) == table
    (tmp_path / "controller.ipynb").write_text("{}")
    assert site_notebooks.page(table) == (
        "| [controller.ipynb](notebooks/controller.ipynb){ download } | drives |\n| `own_path` | bends |\n"
    )


def test_code_headings_and_links_stay_as_they_are() -> None:
    kept = "<h1>The shell</h1><p><code>shell</code> <a href='x.html'>the shell</a> seashells Im</p>"
    linked = with_links(f"{kept}<p>A shell &lt; 1 of I, another shell</p>", "g.html")
    assert linked.startswith(kept.replace("'", '"'))
    assert re.findall(r'href="(g[^"]*)"', linked) == ["g.html#initial-set", "g.html#shell"][::-1]
    assert linked.endswith(" &lt; 1 of " + '<a class="term" href="g.html#initial-set">I</a>, another shell</p>')
