"""The documentation's site, opened from the disk: a few pages, built with the settings of all of them."""

import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import Browser


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
