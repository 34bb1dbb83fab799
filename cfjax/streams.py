"""stdout and stderr that never stop a run: whoever read them may be gone (`| head`), or their disk be full."""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any


@contextmanager
def lasting_streams() -> Iterator[None]:
    """In here, what cannot be printed is dropped; a reader that left is not mentioned, anything else once on stderr."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_Lasting(stream, name) for stream, name in zip(before, ("stdout", "stderr"), strict=True))
    try:
        yield
        sys.stdout.flush()
    finally:
        sys.stdout, sys.stderr = before


class _Lasting:
    """A stream that becomes deaf at its first error; everything else is the stream's own."""

    def __init__(self, stream: Any, name: str) -> None:
        self._stream, self._name = stream, name

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        self._attempt(lambda: self._stream.write(text))
        return len(text)

    def writelines(self, lines: Any) -> None:
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        self._attempt(self._stream.flush)

    def close(self) -> None:
        """Leaves it open: who logs to it may close what is not `sys.stderr` any more, and it is still needed."""
        self.flush()

    def _attempt(self, act: Any) -> None:
        try:
            act()
        except OSError as error:
            with suppress(OSError, ValueError):  # where it has a descriptor: Python flushes what is left at its end
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self._stream.fileno())
                os.close(null)
            if error.errno != errno.EPIPE and self._name == "stdout":
                print(f"warning: {self._name} cannot be written ({error.strerror})", file=sys.stderr)
