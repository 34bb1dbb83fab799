"""For the reference: a field without a docstring is described by the comment at the end of its line.

An extension of griffe, which reads the sources for mkdocstrings. The package writes units and meanings of fields of
dataclasses and named tuples in such comments.
"""

import io
import tokenize
from pathlib import Path
from typing import Any

import griffe


class FieldComments(griffe.Extension):
    """Comments at the ends of lines become docstrings of attributes that have none."""

    def __init__(self) -> None:
        self._comments: dict[Path, dict[int, str]] = {}

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Of each attribute, when griffe has read it."""
        if attr.docstring is not None or attr.lineno is None or attr.parent is None or not attr.parent.is_class:
            return
        path = attr.filepath
        if not isinstance(path, Path):
            return
        if path not in self._comments:
            tokens = tokenize.generate_tokens(io.StringIO(path.read_text()).readline)
            self._comments[path] = {t.start[0]: t.string for t in tokens if t.type == tokenize.COMMENT}
        comment = self._comments[path].get(attr.endlineno or attr.lineno, "").lstrip("# ").strip()
        if comment and not comment.startswith(("noqa", "type:", "pyright:")):
            attr.docstring = griffe.Docstring(comment, parent=attr)
