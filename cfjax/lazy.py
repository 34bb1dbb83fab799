"""Rooms whose names are loaded on first use, so that who needs one of them does not wait for what the others import."""

import ast
import importlib
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any


def on_first_use(package: str, rooms: Sequence[str] = ()) -> Callable[[str], Any]:
    """A package's `__getattr__` (PEP 562), which loads what its `__init__` imports under `if TYPE_CHECKING`.

    Those imports are all that has to be written: type checkers read them, and so does this function. No name may be
    that of a module of the package, which would stand in its place as soon as it is imported. `rooms` are packages and
    modules within, to be had as attributes too.
    """

    def load(name: str) -> Any:
        if name in rooms:
            return importlib.import_module(f"{package}.{name}")
        module = None if name.startswith("__") else _imported_for_types(package).get(name)
        if module is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(module), name)

    return load


def public(name: str) -> Any:
    """A public name of cfjax, loaded now: for a method that hands its object on to a room which it does not know."""
    return getattr(importlib.import_module("cfjax"), name)


@cache
def _imported_for_types(package: str) -> dict[str, str]:
    """Of each name that the package imports under `if TYPE_CHECKING`, the module that has it."""
    loader: Any = sys.modules[package].__loader__
    blocks = [each for each in ast.parse(loader.get_source(package)).body if isinstance(each, ast.If)]
    return {
        alias.name: statement.module or ""
        for block in blocks
        if ast.unparse(block.test) == "TYPE_CHECKING"
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
