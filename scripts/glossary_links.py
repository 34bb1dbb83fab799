"""A hook of mkdocs: on every page the first appearance of a term leads to its row in the glossary.

Headings, code, links and the reference of public names stay as they are.
"""

import re

from bs4 import BeautifulSoup
from bs4.element import NavigableString
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page
from mkdocs.utils import get_relative_url


GLOSSARY, REFERENCE = "glossary.md", "reference/"
TERMS = {  # how each is written on a page, and the first cell of its row
    "PF": "path following",
    "TT": "trajectory tracking",
    "I": "initial set",
    "G": "goal set",
    "S": "safe set",
    "λ": "decrease rate, margin",
    "μ": "margin per metre",
    "β̲": "shell",
    "[Ss]hells?": "shell",
    "[Mm]argins?": "decrease rate, margin",
    "[Tt]ubes?": "tube",
}
SKIPPED = ("a", "code", "pre", "script", "style", *(f"h{level}" for level in range(1, 7)))


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The page's text with links, of the glossary itself with their targets."""
    glossary = files.get_file_from_path(GLOSSARY)
    assert glossary is not None, f"{GLOSSARY} is missing"
    if page.file.src_uri == GLOSSARY:
        return with_targets(html)
    if page.file.src_uri.startswith(REFERENCE):
        return html
    return with_links(html, get_relative_url(glossary.url, page.url))


def with_targets(html: str) -> str:
    """Every row of a table has its first cell for an id."""
    soup = BeautifulSoup(html, "html.parser")
    for row in soup.select("tbody tr"):
        row["id"] = anchor(row.get_text("\n", strip=True).partition("\n")[0])
    return str(soup)


def with_links(html: str, glossary: str) -> str:
    soup = BeautifulSoup(html, "html.parser")
    for written, term in TERMS.items():
        pattern = re.compile(rf"(?<!\w){written}(?!\w)")
        for text in soup.find_all(string=pattern):
            if not text.find_parent(SKIPPED):
                _link(soup, text, pattern, f"{glossary}#{anchor(term)}")
                break
    return str(soup)


def anchor(term: str) -> str:
    return re.sub(r"\W+", "-", term)


def _link(soup: BeautifulSoup, text: NavigableString, pattern: re.Pattern[str], target: str) -> None:
    """In place of the text: what stands before the first match, the link, and what stands behind it."""
    match = pattern.search(text)
    assert match is not None
    link = soup.new_tag("a", href=target, attrs={"class": "term"}, string=match.group())
    text.replace_with(text[: match.start()], link, text[match.end() :])
