#!/usr/bin/env python
"""Look at the built documentation: nothing is fetched from elsewhere, and every public name is in the reference.

    python scripts/check_site.py SITE

Exit 1, with a line for each thing that is wrong.
"""

import argparse
import ast
import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path


PACKAGE = Path(__file__).parents[1] / "cfjax"
# of which attributes a page loads by itself; of <a href> only what is clicked
LOADED = {"src", "srcset", "poster", "data"}
OUTSIDE = re.compile(r"^\s*(https?:)?//", re.IGNORECASE)
STYLE_LINK = re.compile(r"""(?:url\(\s*|@import\s+)['"]?(?:https?:)?//""", re.IGNORECASE)


class Page(HTMLParser):
    """What a page loads, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value is None:
                continue
            if name == "id":
                self.anchors.add(value)
            canonical = tag == "link" and ("rel", "canonical") in attrs
            if name in LOADED or (tag in {"link", "use", "image"} and name in {"href", "xlink:href"} and not canonical):
                self.loads.append(value)


def public_names(package: Path = PACKAGE) -> Iterator[str]:
    """Of the package and its rooms: what `__all__` lists, read without importing anything."""
    for file in (package / "__init__.py", *sorted(package.glob("*/__init__.py"))):
        room = ".".join(file.parent.relative_to(package.parent).parts)
        for node in ast.parse(file.read_text()).body:
            if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["__all__"]:
                yield from (f"{room}.{name}" for name in ast.literal_eval(node.value))


def complaints(site: Path) -> list[str]:
    """One line for each thing that is wrong with the site."""
    found, anchors = [], set()
    for file in sorted(site.rglob("*.html")):
        page = Page(file.read_text())
        anchors |= page.anchors
        found += [f"{file}: loads {load} from elsewhere" for load in page.loads if OUTSIDE.match(load)]
    for file in sorted(site.rglob("*.css")):
        found += [f"{file}: loads {match.group()}… from elsewhere" for match in STYLE_LINK.finditer(file.read_text())]
    return found + [f"{name}: not in the reference" for name in public_names() if name not in anchors]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path, help="folder of the built site")
    site = parser.parse_args().site
    if not (site / "index.html").exists():
        print(f"error: expected a built site, got {site}", file=sys.stderr)
        return 2
    wrong = complaints(site)
    print("\n".join(wrong) if wrong else f"{site}: {len(list(public_names()))} public names, nothing from elsewhere")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
