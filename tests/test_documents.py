"""The documents: links lead somewhere, every public name says what it is; and how `scripts/docs` looks at the site."""

import dataclasses
import importlib
import re
from pathlib import Path

import pytest

from cfjax.conf import Config, preset
from cfjax.conf.schema import PATH_KINDS, VEHICLE_KINDS, CircleConfig
from scripts import keys
from scripts.check_site import complaints, public_names


ROOT = Path(__file__).parents[1]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
MOST_KERNEL_LINES = 2500  # of code and prose: what somebody reads in an afternoon
PAGES = sorted([ROOT / "README.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("experiments/**/*.md")])


def slug(heading: str) -> str:
    """A heading's anchor, as the site and code hosts make it."""
    return re.sub(r"[\s]+", "-", re.sub(r"[^\w\s-]", "", heading.strip().lower()))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    for link in LINK.findall(re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)):
        if link.startswith(("http://", "https://")):
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        assert target.exists(), f"{page.name}: {link}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), flags=re.MULTILINE)
            assert anchor in map(slug, headings), f"{page.name}: {link}"


def test_links_are_found() -> None:
    assert len(LINK.findall((ROOT / "README.md").read_text())) > 20


def test_every_public_class_and_function_says_what_it_is() -> None:
    silent = []
    for name in public_names():
        room, _, last = name.rpartition(".")
        value = getattr(importlib.import_module(room), last)
        # a dataclass or a named tuple without a docstring gets its signature for one
        if callable(value) and (not value.__doc__ or value.__doc__.startswith(f"{last}(")):
            silent.append(name)
    assert silent == []


def test_the_site_is_looked_at(tmp_path: Path) -> None:
    everything = "".join(f'<h2 id="{name}">' for name in public_names())
    page = tmp_path / "index.html"
    page.write_text(f'<a href="https://example.org">clicked only</a><img src="images/hero.png">{everything}')
    assert complaints(tmp_path) == []
    for outside in (
        '<script src="https://example.org/a.js"></script>',
        '<img src="//example.org/a.png">',
        '<link rel="stylesheet" href="http://example.org/a.css">',
    ):
        page.write_text(everything + outside)
        (found,) = complaints(tmp_path)
        assert "from elsewhere" in found
    page.write_text(everything.replace('id="cfjax.Problem"', ""))
    assert complaints(tmp_path) == ["cfjax.Problem: not in the reference"]
    page.write_text(everything)
    (tmp_path / "a.css").write_text("@import url(https://example.org/b.css);")
    (found,) = complaints(tmp_path)
    assert "from elsewhere" in found


def test_the_reference_of_keys_is_up_to_date() -> None:
    written = keys.PAGE.read_text("utf-8")
    assert written == keys.page(written), "python scripts/keys.py writes it"


def test_every_key_is_in_the_reference() -> None:
    content, config = keys.PAGE.read_text("utf-8"), preset("circle")
    expected = {field.name for field in dataclasses.fields(Config)}
    for group in ("sets", "polytope", "proof", "objective", "wandb", "law"):
        expected.remove(group)
        expected |= {f"{group}.{name}" for name in vars(getattr(config, group))}
    for group, kinds in (("path", PATH_KINDS), ("vehicle", VEHICLE_KINDS)):
        expected.remove(group)
        names = {field.name for kind in kinds.values() for field in dataclasses.fields(kind)}
        expected |= {f"{group}.{name}" for name in names - {"name", "kind"}}
    assert set(re.findall(r"^\| `([a-z0-9_.]+)` \| (?:a|an|true|names) ", content, re.MULTILINE)) == expected


def test_what_a_key_means_is_its_own_comment_or_that_of_what_it_is_made_of() -> None:
    assert keys.keys_of(CircleConfig, "path.")[0] == ("`path.radius`", "a number", "m", "`1.5`", "of the circle")
    of_a_run = {key.name: key for key in keys.keys_of(Config)}
    assert of_a_run["`seed`"].meaning == "of all random numbers"  # in `cfjax.options`
    assert of_a_run["`certificate`"].meaning.startswith("`segment`, funnels")


@dataclasses.dataclass
class Silent:
    number: float = 1.0


def test_a_key_that_nothing_describes_is_refused() -> None:
    with pytest.raises(ValueError, match=r"group\.number: no comment says what it means"):
        keys.keys_of(Silent, "group.")


def test_whoever_reads_the_checker_is_led_through_all_of_it() -> None:
    page = (ROOT / "docs" / "reading-the-checker.md").read_text()
    package = ROOT / "cfcheck"
    modules = {f.relative_to(package).as_posix() for f in package.rglob("*.py") if not f.name.startswith("__")}
    assert {module for module in modules if page.count(f"`{module}`") != 1} == set()


def test_the_checker_defines_every_name_that_the_walk_through_it_mentions() -> None:
    page = (ROOT / "docs" / "reading-the-checker.md").read_text()
    code = "\n".join(file.read_text() for file in (ROOT / "cfcheck").rglob("*.py"))
    names = {part for name in re.findall(r"`([A-Za-z_.]+)`", page) if "/" not in name for part in name.split(".")}
    assert len(names) > 30
    missing = {name for name in names if not re.search(rf'(?:def|class) {name}\b|"{name}"', code)}
    assert missing - {"py", "json", *(file.stem for file in (ROOT / "cfcheck").rglob("*.py"))} == set()


def test_the_checkers_kernel_can_be_read_in_an_afternoon() -> None:
    kernel = [f for room in ("exact", "path", "kernel") for f in (ROOT / "cfcheck" / room).glob("*.py")]
    assert sum(len(f.read_text().splitlines()) for f in kernel) <= MOST_KERNEL_LINES
