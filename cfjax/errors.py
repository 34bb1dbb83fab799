"""Errors that are one line for a user: a question that cannot be asked, and an answer that cannot be written."""

from typing import Any


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
