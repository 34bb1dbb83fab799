"""Programs that are traced once per machine: what tracing and lowering gave is kept beside JAX's compiled programs.

JAX keeps what it has compiled, but traces and lowers each program anew in every process, which takes longer than to
run the largest ones. Here the lowered program is kept too, as `jax.export` serialises it. It is found again only by the
same code: its name holds a hash of every source file of the package, of the versions of JAX and of the shapes of the
arguments, and what their static arguments are (`cfjax.identity`). Programs with parts that have no such text, a law of
the user's own, say, are traced as always. A vehicle of the user's own has one as JAX traces it
(`cfjax.problem.traced_vehicle`).

A program is compiled once, however many threads ask for it: whoever comes while it is being made waits for it.
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import Any

import jax
import numpy as np
from jax import export

from cfjax.identity import identity


PACKAGES = "cfjax", "cfcheck"
UNKNOWN_OPTION = "No such compile option"
FOLDER = "traced"  # within JAX's compilation cache


@cache
def traced(function: Callable[..., Any], *static: Hashable, options: tuple[tuple[str, Any], ...] = ()) -> "Traced":
    """`function(*static, …)` compiled for arrays, as `jax.jit` has it; `static` are what `static_argnums` are there.

    `options` are the compiler's, as pairs.
    """
    return Traced(partial(function, *static), identity((function, *static)), dict(options))


class Traced:
    """One program, for each shape of its arguments."""

    def __init__(self, function: Callable[..., Any], name: str | None, options: dict[str, Any]) -> None:
        self.function, self.name, self.options = function, name, options
        self.programs: dict[tuple, Callable[..., Any]] = {}
        self._making: dict[tuple, Lock] = {}

    def __call__(self, *arguments: Any) -> Any:
        program, leaves = self._found(arguments)
        return program(*leaves)

    def side_by_side(self, shares: Sequence[tuple]) -> Any:
        """The program's answers, as NumPy arrays, to arguments of one shape each, found at the same time.

        XLA runs small operations on one core of a processor: a second share on another one takes little longer.
        """
        with ThreadPoolExecutor(len(shares)) as pool:
            return list(pool.map(lambda arguments: jax.tree.map(np.asarray, self(*arguments)), shares))

    def prepare(self, *arguments: Any) -> None:
        """Make the program for arguments of these shapes, whatever their values, and do not run it."""
        self._found(arguments)

    def _found(self, arguments: tuple) -> tuple[Callable[..., Any], list[Any]]:
        leaves, tree = jax.tree.flatten(arguments)
        leaves = [leaf if isinstance(leaf, jax.Array) else np.asarray(leaf) for leaf in leaves]
        shapes = tree, *((leaf.shape, leaf.dtype.name) for leaf in leaves)
        if shapes not in self.programs:
            with self._making.setdefault(shapes, Lock()):
                if shapes not in self.programs:
                    self.programs[shapes] = self._compiled(self._lowered(shapes, leaves))
        return self.programs[shapes], leaves

    def _compiled(self, lowered: jax.stages.Lowered) -> Callable[..., Any]:
        """Without the options where this version of XLA does not know one of them: they save time, and no more."""
        try:
            return lowered.compile(self.options)
        except jax.errors.JaxRuntimeError as error:
            if UNKNOWN_OPTION not in str(error):
                raise
            return lowered.compile()

    def _lowered(self, shapes: tuple, leaves: list[Any]) -> jax.stages.Lowered:
        tree = shapes[0]

        def flat(*values: Any) -> Any:
            return self.function(*jax.tree.unflatten(tree, values))

        program = jax.jit(flat)
        folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
        if folder is None or self.name is None:
            return program.lower(*leaves)
        text = "\n".join([self.name, *map(str, shapes), source_hash(), jax.default_backend(), sys.version])
        file = Path(folder) / FOLDER / hashlib.sha256(text.encode()).hexdigest()
        try:
            kept = export.deserialize(bytearray(file.read_bytes()))
        except Exception:  # there is none, or not a whole one
            kept = export.export(program)(*leaves)
            _write(file, kept)
        return jax.jit(kept.call).lower(*leaves)


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
    """Of every source file of both packages, and of the versions of JAX."""
    digest = hashlib.sha256(f"{version('jax')} {version('jaxlib')}".encode())
    for package in PACKAGES:  # found, not imported: that takes longer
        spec = find_spec(package)
        assert spec is not None and spec.origin is not None
        folder = Path(spec.origin).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(f"{package}/{file.relative_to(folder)} ".encode() + file.read_bytes())
    return digest.hexdigest()
