"""Programs that are traced once per machine: what tracing and lowering gave is kept beside JAX's compiled programs.

JAX keeps what it has compiled, but traces and lowers each program anew in every process, which takes longer than to
run the largest ones. Here the lowered program is kept too, as `jax.export` serialises it. It is found again only by the
same code: its name holds a hash of every source file of the package, of the versions of JAX and of the shapes of the
arguments. Programs with parts from elsewhere, a vehicle of the user's own, say, are traced as always.
"""

import dataclasses
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import Any

import jax
import numpy as np
from jax import export


PACKAGE = Path(__file__).parent
FOLDER = "traced"  # within JAX's compilation cache


@cache
def traced(function: Callable[..., Any], *static: Hashable) -> Callable[..., Any]:
    """`function(*static, …)` compiled for arrays, as `jax.jit` has it; `static` are what `static_argnums` are there."""
    return _Traced(partial(function, *static), identity((function, *static)))


class _Traced:
    """One program, for each shape of its arguments."""

    def __init__(self, function: Callable[..., Any], name: str | None) -> None:
        self.function, self.name = function, name
        self.programs: dict[tuple, Callable[..., Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        leaves, tree = jax.tree.flatten(arguments)
        leaves = [leaf if isinstance(leaf, jax.Array) else np.asarray(leaf) for leaf in leaves]
        shapes = tree, *((leaf.shape, leaf.dtype.name) for leaf in leaves)
        if shapes not in self.programs:
            self.programs[shapes] = self._program(shapes, leaves)
        return self.programs[shapes](*leaves)

    def _program(self, shapes: tuple, leaves: list[Any]) -> Callable[..., Any]:
        tree = shapes[0]

        def flat(*values: Any) -> Any:
            return self.function(*jax.tree.unflatten(tree, values))

        program = jax.jit(flat)
        folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
        if folder is None or self.name is None:
            return program
        text = "\n".join([self.name, *map(str, shapes), source_hash(), jax.default_backend(), sys.version])
        file = Path(folder) / FOLDER / hashlib.sha256(text.encode()).hexdigest()
        try:
            kept = export.deserialize(bytearray(file.read_bytes()))
        except Exception:  # there is none, or not a whole one
            kept = export.export(program)(*leaves)
            _write(file, kept)
        return jax.jit(kept.call)


def _write(file: Path, kept: export.Exported) -> None:
    """Whole or not at all; nobody needs to hear of a folder that does not take it."""
    with suppress(OSError, ValueError):
        file.parent.mkdir(exist_ok=True)
        handle, draft = tempfile.mkstemp(dir=file.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(kept.serialize())
        os.replace(draft, file)


@cache
def source_hash() -> str:
    """Of every source file of the package, and of the versions of JAX."""
    digest = hashlib.sha256(f"{version('jax')} {version('jaxlib')}".encode())
    for file in sorted(PACKAGE.rglob("*.py")):
        digest.update(f"{file.relative_to(PACKAGE)} ".encode() + file.read_bytes())
    return digest.hexdigest()


def identity(value: object) -> str | None:
    """Text that is the same for equal values, in every process; None where it depends on code from elsewhere."""
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    if isinstance(value, tuple):
        parts = [identity(each) for each in value]
        return None if None in parts else f"({', '.join(map(str, parts))})"
    kind = value if isinstance(value, type | FunctionType) else type(value)
    if kind.__module__.partition(".")[0] != __name__.partition(".")[0] or "<locals>" in kind.__qualname__:
        return None
    if kind is value:
        return f"{kind.__module__}.{kind.__qualname__}"
    fields = [field.name for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else vars(value)
    own = identity(tuple((name, getattr(value, name)) for name in fields))
    return None if own is None else f"{kind.__module__}.{kind.__qualname__}{own}"
