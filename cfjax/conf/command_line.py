"""A command line as people type it, in the form that Hydra's grammar reads."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, Quote, QuotedString
from hydra.errors import HydraException

from cfjax.conf.messages import CHOICES, PLACES, expected_at, is_list_of_texts, is_named_values, is_text
from cfjax.errors import InputError, renamed


DEFAULT_PATH = "oval"
VERBOSE = "hydra.verbose"  # true, or the loggers that are to say more: Hydra takes any word for a logger
GROUPS = ("path", "vehicle", "objective", "law", "experiment")
RENAMED = {"authority": "input_share"}  # keys, by their former names
KEY = re.compile(r"(\+{0,2})([^\W\d][\w-]*(?:\.[\w-]+)*)")


def hydra_overrides(given: Sequence[str], *, sweep: bool) -> list[str]:
    """The overrides of a command line as Hydra reads them, with the default path where they choose none.

    A text (the name of a file, say) is quoted where the grammar would read something else. In a sweep commas part its
    values, unless a file has that name. `+` is set where Hydra needs it, and may be left out or be one too many.

    Raises:
        InputError: for what is no key=value, and a value that the grammar does not read.
    """
    forms = [_form(each, sweep) for each in given]
    for group in GROUPS:
        chosen = [form.partition("=")[2] for form in forms if form.lstrip("+").partition("=")[0] == group]
        if len(chosen) > 1:
            raise InputError(f"{group}: expected one of its presets, got {' and '.join(chosen)}")
    return forms if any(form.startswith("+path=") for form in forms) else [f"+path={DEFAULT_PATH}", *forms]


def values_of(override: str) -> list[str]:
    """The texts that an override sets its key to, one for each job of a sweep."""
    parsed = _parsed(override)
    if parsed is None:
        return []
    values = parsed.sweep_iterator() if parsed.is_sweep_override() else [parsed.value()]
    return [value.text if isinstance(value, QuotedString) else str(value) for value in values]


def _form(given: str, sweep: bool) -> str:
    name, equals, value = given.partition("=")
    if re.match(r"[+~]*hydra[./]", name) and name not in PLACES and not is_text(name):
        parsed = _parsed(given)
        if parsed is None:
            raise InputError(f"{name}: expected a value that Hydra's grammar reads, got {value or given}")
        if name == VERBOSE and not parsed.is_sweep_override() and not isinstance(parsed.value(), bool | list):
            raise InputError(f"{name}: expected true, false or a list of loggers, like [hydra], got {value}")
        return given
    match = KEY.fullmatch(name)
    if not match or not equals:
        raise InputError(f"expected key=value, without ~ or @ and without blanks around =, got {given}")
    key = match[2]
    if key in RENAMED:
        renamed(key, RENAMED[key])
        key = RENAMED[key]
    sign = "+" if key == "path" else "++" if is_named_values(key) else ""
    if is_list_of_texts(key):
        value = _list(key, value, sweep)
    as_text = is_text(key) and key not in CHOICES
    return f"{sign}{key}={_text(key, value, sweep) if as_text else _value(key, value, sweep)}"


def _value(key: str, value: str, sweep: bool) -> str:
    wanted = "the name of a preset" if key in GROUPS else expected_at(key)
    parsed = _parsed(f"{key}={value}")
    if parsed is None:
        raise InputError(f"{key}: expected {wanted}, got {value}" if wanted else f"{key}: no such key")
    if parsed.is_sweep_override() and not sweep:
        raise InputError(f"{key}: expected {wanted or 'one value'}, got {value}; with -m it is a sweep over its values")
    if key in GROUPS and not parsed.is_sweep_override() and not isinstance(parsed.value(), str):
        raise InputError(f"{key}: expected {wanted}, got {value or 'nothing'}")
    return value


def _list(key: str, value: str, sweep: bool) -> str:
    """Texts between commas as a list whose entries are quoted, where the grammar would read something else."""
    parsed, bare = _parsed(f"{key}={value}"), value.strip()
    if parsed is not None and (sweep or not parsed.is_sweep_override()):
        return value
    if re.fullmatch(r"\[(\[[^\[\]]*\]|[^\[\]])*\]", bare):
        bare = bare[1:-1]
    elif "," not in bare:
        return value
    return f"[{','.join(QuotedString(part.strip(), Quote.single).with_quotes() for part in bare.split(','))}]"


def _text(key: str, value: str, sweep: bool) -> str:
    place = key in PLACES
    if place and not value.strip():
        raise InputError(f"{key}: expected a name, got nothing")
    if place and Path(_expanded(value)).exists():
        return _quoted(key, _expanded(value).replace("${", "\\${"))
    parsed = _parsed(f"{key}={value}")
    read: Any = None if parsed is None or parsed.is_sweep_override() else parsed.value()
    if isinstance(read, str) and read == value.strip() != value:
        return _quoted(key, value)
    if isinstance(read, str):
        return _quoted(key, _expanded(read)) if place and read.startswith("~") else value
    if parsed is not None and not parsed.is_sweep_override() and read is None:  # null
        return value
    parts = [part.strip() for part in value.split(",")]
    if not sweep and place and len(parts) > 1 and all(Path(_expanded(part)).exists() for part in parts):
        raise InputError(f"{key}: expected one name, got {value}; with -m it is a sweep over them")
    if not sweep:
        return _quoted(key, _expanded(value) if place else value)
    if parsed is not None and parsed.is_sweep_override():
        return value
    return ",".join(_quoted(key, _expanded(part) if place else part) for part in parts)


def _expanded(value: str) -> str:
    return os.path.expanduser(value)


def _quoted(key: str, text: str) -> str:
    """The text as it is, where Hydra reads just that; else in quotation marks."""
    parsed = _parsed(f"{key}={text}")
    same = parsed is not None and not parsed.is_sweep_override() and parsed.value() == text
    return text if same else QuotedString(text, Quote.single).with_quotes()


def _parsed(override: str) -> Override | None:
    try:
        return OverridesParser.create().parse_override(override)
    except HydraException:
        return None
