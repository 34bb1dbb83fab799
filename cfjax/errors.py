"""Errors that end a search: bad input, a result that cannot be written, Ctrl-C after a proof."""

import difflib
import sys
from collections.abc import Iterable
from typing import Any


def meant(given: str, names: Iterable[str]) -> str:
    """The end of a line: which of the names somebody may have meant who mistyped one; nothing where none is near."""
    near = difflib.get_close_matches(given, list(names), n=1)
    return f"; did you mean {near[0]}?" if near else ""


def renamed(old: str, new: str) -> None:
    """Warn, in one line on stderr, that a key or an argument has another name now; the old one works until 0.2."""
    print(f"warning: {old} is called {new} now; the old name works until version 0.2", file=sys.stderr)


class InputError(ValueError):
    """Bad configuration or input. The message is one line that says what was expected and what was given.

    Raised where objects are constructed, so that nothing is computed or written before; commands print the message
    and exit with 2.
    """


class NotWritten(RuntimeError):
    """A disk is full, or a folder is gone or may not be written. The message is one line; commands exit with 3.

    `result` is what could not be written, a `cfjax.result.Result`, where the work was done already.
    """

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, when an earlier round had proven something: `result` is that, a `cfjax.result.Result`."""

    def __init__(self, result: Any = None) -> None:  # a worker hands it on without
        super().__init__()
        self.result = result
