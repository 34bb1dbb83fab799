"""The C controller from Python, for tests and benchmarks only: compile, load, call.

Not for driving: a car runs the C, and Python has the law itself (`cfjax.control`).
"""

import ctypes
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from cfjax.export.controller import SOURCE


WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror")
OK, PAST_END, OUTSIDE, BAD_INPUT = range(4)  # cf_status


def compiler() -> str | None:
    """The C compiler: `CC` or `cc`; None where there is none."""
    return shutil.which(os.environ.get("CC", "cc"))


def compile_controller(folder: Path, *flags: str, main: Path | None = None) -> Path:
    """A shared library of the controller in `folder`, or a program where a `main` is given; warnings are errors.

    Raises:
        RuntimeError: with what the compiler says, where it says something.
    """
    found = compiler()
    if found is None:
        raise RuntimeError("no C compiler: set CC or install cc")
    target = folder / (main.stem if main else "controller.so")
    kind = [str(main)] if main else ["-shared", "-fPIC"]
    command = [
        found,
        *WARNINGS,
        "-O2",
        *flags,
        *kind,
        str(folder / SOURCE),
        "-I",
        str(folder),
        "-o",
        str(target),
        "-lm",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or done.stderr:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    return target


class CompiledController:
    """One controller: the functions of the header, arrays in and out."""

    def __init__(self, library: Path, states: int, inputs: int, commands: int) -> None:
        class Memory(ctypes.Structure):
            _fields_ = [
                ("theta", ctypes.c_double),
                ("leg", ctypes.c_int),
                ("lap", ctypes.c_ulong),
                ("piece", ctypes.c_int),
                ("cell", ctypes.c_int),
                ("value", ctypes.c_double),
                ("state", ctypes.c_double * states),
                ("inputs", ctypes.c_double * inputs),
            ]

        self._library = ctypes.CDLL(str(library))
        self._library.cf_value.restype = ctypes.c_double
        self._inputs, self._commands, self._states = inputs, commands, states
        self.memory: Any = Memory()

    def reset(self) -> None:
        self._library.cf_reset(ctypes.byref(self.memory))

    def start(self, state: Float[np.ndarray, "..."]) -> int:
        return self._library.cf_start(ctypes.byref(self.memory), self._pointer(state))

    def step(self, state: Float[np.ndarray, "..."], dt: float) -> tuple[int, Float[np.ndarray, "..."]]:
        command = np.full(self._commands, np.nan)
        status = self._library.cf_step(
            ctypes.byref(self.memory), self._pointer(state), ctypes.c_double(dt), self._pointer(command)
        )
        return status, command

    def inputs(
        self, theta: float, leg: int, deviation: Float[np.ndarray, "..."]
    ) -> tuple[int, Float[np.ndarray, "..."]]:
        found = np.full(self._inputs, np.nan)
        status = self._library.cf_inputs(ctypes.c_double(theta), leg, self._pointer(deviation), self._pointer(found))
        return status, found

    def inputs_of_many(
        self, theta: Float[np.ndarray, "..."], leg: Sequence[int], deviation: Float[np.ndarray, "..."]
    ) -> tuple[list[int], Float[np.ndarray, "..."]]:
        """Statuses and rows of inputs, one call after another."""
        found = np.full((len(theta), self._inputs), np.nan)
        rows, answers, call = self._pointer(deviation).value, found.ctypes.data, self._library.cf_inputs
        statuses = [
            call(
                ctypes.c_double(at),
                own,
                ctypes.c_void_p(rows + i * deviation.strides[0]),
                ctypes.c_void_p(answers + i * found.strides[0]),
            )
            for i, (at, own) in enumerate(zip(theta.tolist(), leg, strict=True))
        ]
        return statuses, found

    def value(self, theta: float, leg: int, deviation: Float[np.ndarray, "..."]) -> float:
        return self._library.cf_value(ctypes.c_double(theta), leg, self._pointer(deviation))

    def deviation(self, theta: float, state: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        found = np.full(self._states, np.nan)
        self._library.cf_deviation(ctypes.c_double(theta), self._pointer(state), self._pointer(found))
        return found

    def from_ros(self, x: float, y: float, yaw: float) -> Float[np.ndarray, " n"]:
        """A state, of which the pose alone is written."""
        state = np.full(self._states, np.nan)
        self._library.cf_from_ros(*map(ctypes.c_double, (x, y, yaw)), self._pointer(state))
        return state

    def to_ros(self, state: Float[np.ndarray, "..."]) -> Float[np.ndarray, "3"]:
        found = np.full(3, np.nan)
        ends = [ctypes.c_void_p(found.ctypes.data + k * found.itemsize) for k in range(3)]
        self._library.cf_to_ros(self._pointer(state), *ends)
        return found

    @staticmethod
    def _pointer(values: Float[np.ndarray, "..."]) -> Any:
        if values.dtype != np.float64 or not values.flags.c_contiguous:
            raise TypeError(f"expected contiguous doubles, got {values.dtype}")
        return ctypes.c_void_p(values.ctypes.data)
