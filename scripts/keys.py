#!/usr/bin/env python
"""Write the reference of all keys into docs/keys.md, from the comments in `cfjax/conf` and from its presets.

    python scripts/keys.py

What stands above the line MADE is written by hand and stays. `tests/test_documents.py` compares the rest.
"""

import dataclasses
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import griffe
from omegaconf import MISSING, OmegaConf

from cfjax.conf import preset_folder
from cfjax.conf.command_line import DEFAULT_PATH, GROUPS
from cfjax.conf.messages import expected_at, shown
from cfjax.conf.schema import PATH_KINDS, VEHICLE_KINDS, Config


ROOT = Path(__file__).parents[1]
PAGE, CONF = ROOT / "docs" / "keys.md", preset_folder()
MADE = "<!-- below: made by scripts/keys.py -->"
BY_PRESET = ("name", "kind")  # of a path and a vehicle: the preset's own
UNIT = re.compile(r"(m/s²|m/s|1/m|1/s|m|s|h|GB)(?:, |; |$)")
KINDS: dict[str, Mapping[str, type]] = {"path": PATH_KINDS, "vehicle": VEHICLE_KINDS}  # whose class a preset chooses
GROUPED = {
    field.name: field.default_factory
    for field in dataclasses.fields(Config)
    if isinstance(field.default_factory, type) and dataclasses.is_dataclass(field.default_factory)
}


class Key(NamedTuple):
    """A row of the page."""

    name: str
    takes: str
    unit: str
    default: str
    meaning: str


def page(written: str) -> str:
    """The page: what is written by hand above the line MADE, and everything below it."""
    return written.partition(MADE)[0] + MADE + "\n\n" + "\n\n".join(_parts()) + "\n"


def keys_of(owner: type, prefix: str = "") -> list[Key]:
    """The keys of a class of the schema that hold values.

    Raises:
        ValueError: for a key that nothing describes.
    """
    others = {*KINDS, *GROUPED} if owner is Config else BY_PRESET if prefix.rstrip(".") in KINDS else ()
    return [_key(owner, prefix, field) for field in dataclasses.fields(owner) if field.name not in others]


def _parts() -> Iterator[str]:
    yield "## Groups"
    for group in GROUPS:
        yield f"### {group}"
        yield _table(("choice", "what it is", "its keys, where they are not the defaults"), list(_presets(group)))
    yield "## Keys of a run"
    yield _table(Key._fields, keys_of(Config))
    kinds = [(f"{group}: {kind}", owner) for group in KINDS for kind, owner in KINDS[group].items()]
    for heading, owner in [*GROUPED.items(), *kinds]:
        yield f"## {heading}"
        yield _typed(str(owner.__doc__))
        yield _table(Key._fields, keys_of(owner, f"{heading.partition(':')[0]}."))


def _key(owner: type, prefix: str, field: dataclasses.Field[Any]) -> Key:
    name = f"{prefix}{field.name}"
    said = _description(owner, field.name)
    if not said:
        raise ValueError(f"{name}: no comment says what it means")
    unit = UNIT.match(said)
    default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
    return Key(
        f"`{name}`",
        str(expected_at(name, owner)),
        unit[1] if unit else "",
        "has to be given" if default == MISSING else f"`{shown(default)}`",
        _typed(said[unit.end() :] if unit else said).rstrip("."),
    )


def _description(owner: type, name: str) -> str:
    """Beside the key, where its class or one above has it; else where its default comes from."""
    classes = [
        _source(f"{each.__module__}.{each.__name__}") for each in owner.__mro__ if dataclasses.is_dataclass(each)
    ]
    for each in classes:
        if said := _said(each, name):
            return said
    default = classes[0].attributes[name].value
    if not isinstance(default, griffe.ExprAttribute):
        return ""
    other, _, field = default.canonical_path.rpartition(".")
    return _said(_source(other), field)


def _source(path: str) -> griffe.Object | griffe.Alias:
    package, _, inside = path.partition(".")
    return _package(package)[inside]


@cache
def _package(name: str) -> griffe.Object | griffe.Alias:
    extensions = griffe.load_extensions(str(ROOT / "scripts" / "field_comments.py"))
    return griffe.load(name, search_paths=[ROOT], extensions=extensions)


def _said(owner: griffe.Object | griffe.Alias, name: str) -> str:
    """What a class says of a field: its comment, or the entry under Args."""
    for section in owner.docstring.parse("google") if owner.docstring else ():
        for entry in section.value if isinstance(section, griffe.DocstringSectionParameters) else ():
            if entry.name == name:
                return entry.description
    field = owner.attributes.get(name)
    return field.docstring.value if field and field.docstring else ""


def _presets(group: str) -> Iterator[tuple[str, str, str]]:
    for file in sorted((CONF / group).glob("*.yaml")):
        lines = file.read_text("utf-8").splitlines()
        comments = [line.lstrip("# ") for line in lines if line.startswith("#") and "@package" not in line]
        content: Any = OmegaConf.to_container(OmegaConf.load(file))
        kind = next((kind for each in content.pop("defaults", ()) for kind in each.values()), "")
        swept = content.pop("hydra", {}).get("sweeper", {}).get("params", {})
        values = dict(_flat(content, "" if "@package _global_" in lines[0] else f"{group}."))
        given = [f"`{key}={shown(value)}`" for key, value in {**values, **swept}.items() if _is_own(kind, key, value)]
        chosen = " (default)" if file.stem == _chosen(group) else ""
        yield f"`{file.stem}`{chosen}", _typed(" ".join(comments)), " ".join(given)


def _is_own(kind: str, key: str, value: Any) -> bool:
    """Whether a preset's value is another than the default of its kind."""
    first, _, name = key.rpartition(".")
    owner = KINDS[first][kind] if first in KINDS and kind else GROUPED.get(first, Config)
    defaults = {each.name: each.default for each in keys_of(owner, f"{first}." if first else "")}
    return name not in BY_PRESET and defaults.get(f"`{key}`") != f"`{shown(value)}`"


def _chosen(group: str) -> str | None:
    """The preset where none is chosen."""
    defaults: Any = OmegaConf.to_container(OmegaConf.load(CONF / "train.yaml"))
    named = {name: choice for each in defaults["defaults"] if isinstance(each, dict) for name, choice in each.items()}
    return DEFAULT_PATH if group == "path" else named[group]


def _flat(values: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [" | ".join(head), " | ".join("---" for _ in head), *(" | ".join(row) for row in rows)]
    return "\n".join(f"| {line} |" for line in lines)


def _typed(said: str) -> str:
    """A description in one line, its values as one types them on the command line: null, and names without quotes."""
    return re.sub(r"\bNone\b", "null", re.sub(r'"(\w+)"', r"`\1`", " ".join(said.split())))


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text("utf-8")), encoding="utf-8")
