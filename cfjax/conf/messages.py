"""What goes wrong with a configuration, in one line of ours: `key: expected WHAT, got WHAT`, whoever noticed it."""

import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any

from hydra.errors import MissingConfigException
from omegaconf import DictConfig, Node
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, InterpolationResolutionError, OmegaConfBaseException

from cfjax.conf.schema import PATH_KINDS, VEHICLE_KINDS, Config
from cfjax.errors import meant


GROUPS: dict[str, Mapping[str, type]] = {"path": PATH_KINDS, "vehicle": VEHICLE_KINDS}  # whose class a preset chooses
PLACES = ("path.file", "hydra.run.dir", "hydra.sweep.dir")
TEXTS = ("hydra.run.dir", "hydra.sweep.dir", "hydra.sweep.subdir", "hydra.job.name")  # of Hydra's own keys
CHOICES = (  # texts that are one of a few names: commas part them
    *("method", "template", "certificate", "learner", "solver", "logger", "frame", "objective.kind"),
    *("law.kind", "wandb.mode"),
    *("polytope.centre", "polytope.demonstrations"),
)
WORDS: dict[Any, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
    list[float]: "a list of numbers, like [0.5, 2]",
    list[str]: "a list of texts, like [a, b]",
    dict[str, Any]: "names with values, like {mass: 2}",
}
MERGING = "Error merging override "  # how Hydra begins where OmegaConf took exception to a value


def one_line(error: BaseException) -> str:
    """An error's message without line breaks, and in our words where it is about a key of the configuration."""
    whole, cause = str(error).strip(), error.__cause__
    if isinstance(error, MissingConfigException) and error.missing_cfg_file:
        group, _, choice = str(error.missing_cfg_file).rpartition("/")
        if not error.options:
            return f"--config-name: expected the name of a configuration, got {choice}"
        return f"{group}: expected one of {', '.join(error.options)}, got {choice}{meant(choice, error.options)}"
    if isinstance(cause, OmegaConfBaseException) and cause.full_key:
        override = whole.splitlines()[0].removeprefix(MERGING) if whole.startswith(MERGING) else ""
        return _about_a_key(cause, override)
    if isinstance(error, OmegaConfBaseException) and error.full_key:
        return _about_a_key(error, "")
    kept = [line.strip() for line in whole.splitlines() if line.strip()]
    return " ".join(line for line in kept if not line.startswith("See https://hydra.cc")) or type(error).__name__


def shown(value: Any) -> str:
    """A value as one types it on a command line or in YAML."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {shown(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(shown, value)) + "]"
    return str(value) or "nothing"


def expected_at(key: str, owner: Any = None) -> str | None:
    """What may stand at a key of the configuration, in words; None where there is no such key.

    `owner`: the class that has it, where a preset chooses between classes.
    """
    if key in TEXTS:
        return WORDS[str]
    if key in CHOICES:
        return "a name"
    declared = _declared(key)
    own = [each for each in declared if each[0] is owner] or declared
    return _words(key, *own[0][1:]) if own else None


def is_text(key: str) -> bool:
    """Whether the value at a key is a text, whatever it looks like."""
    hints = [hint for *_, hint in _declared(key)]
    return key in TEXTS or (bool(hints) and all(set(_members(hint)) <= {str, type(None)} for hint in hints))


def is_list_of_texts(key: str) -> bool:
    """Whether the value at a key is a list of texts."""
    return any(list[str] in _members(hint) for *_, hint in _declared(key))


def is_named_values(key: str) -> bool:
    """Whether the key is one of values under names of the user's own, or a name in them: vehicle.parameters.mass."""
    head = ".".join(key.split(".")[:2])
    return any(typing.get_origin(hint) is dict for *_, hint in _declared(head))


def _about_a_key(error: OmegaConfBaseException, override: str) -> str:
    key = str(error.full_key)
    if isinstance(error, InterpolationResolutionError):
        node = error.parent_node._get_node(error.key) if isinstance(error.parent_node, DictConfig) else None
        got = override.partition("=")[2] or (str(node._value()) if isinstance(node, Node) else "")
        return f"{key}: expected ${{...}} to name what there is{f', got {got}' if got else ''}"
    if isinstance(error, ConfigKeyError | ConfigAttributeError) and isinstance(error.parent_node, DictConfig):
        known = [str(each) for each in error.parent_node if each != "hydra"]
        above, _, own = key.rpartition(".")
        return f"{key}: no such key; " + (
            f"expected one of {', '.join(known)}{meant(own, known)}"
            if known
            else f"{above}: expected {expected_at(above)}"
        )
    name, _, value = override.partition("=")
    typed_at = key.partition("[")[0]  # timing[0]
    wanted = expected_at(typed_at, error.object_type)
    if wanted is None:
        message = str(error.msg or error).strip().splitlines()[0]
        return message if key in message else f"{key}: {message}"
    if name.lstrip("+~") not in ("", typed_at):  # cars.x=3
        got = override
    else:
        got = value or (shown(error.value) if error.value is not None or "not Optional" in str(error) else "")
    return f"{typed_at}: expected {wanted}, got {got or 'another kind of value'}"


def _declared(key: str) -> list[tuple[type, dataclasses.Field[Any], Any]]:
    """Class, field and type that a key may mean: several where a preset chooses between classes."""
    first, *rest = key.split(".")
    if not rest:
        classes: list[type] = [Config]
    elif first in GROUPS:
        classes = list(GROUPS[first].values())
    else:
        classes = [hint for *_, hint in _declared(first) if dataclasses.is_dataclass(hint)]  # pyright: ignore
    if len(rest) > 1:
        return []
    name = rest[0] if rest else first
    return [
        (each, field, typing.get_type_hints(each)[name])
        for each in classes
        for field in dataclasses.fields(each)
        if field.name == name
    ]


def _members(hint: Any) -> tuple[Any, ...]:
    return typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)


def _words(key: str, field: dataclasses.Field[Any], hint: Any) -> str:
    if "expected" in field.metadata:
        return field.metadata["expected"]
    if dataclasses.is_dataclass(hint):
        return f"a value for one of its keys, like {key}.{dataclasses.fields(hint)[0].name}"
    named = [WORDS.get(each, "a value") for each in _members(hint) if each is not type(None)]
    return " or ".join([*named, *(["null"] if type(None) in _members(hint) else [])])
