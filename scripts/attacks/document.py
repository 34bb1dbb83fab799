"""Places in a certificate, and the file with its hash renewed."""

import json
import random
from collections.abc import Callable, Iterator
from typing import Any

from attacks.margins import METRE, SECOND
from cfcheck.claims.document import document_hash


Document = dict[str, Any]
Attack = Callable[[random.Random, Document], "Document | bytes"]


def leaves(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths of everything in a document but single Gram entries."""
    yield path
    if isinstance(value, dict):
        for key, child in value.items():
            yield from leaves(child, (*path, key))
    elif isinstance(value, list) and not (path and path[-1] == "lower" and len(value) > 1):
        for key, child in enumerate(value):
            yield from leaves(child, (*path, key))


def parent(document: Document, path: tuple) -> tuple[Any, Any]:
    for key in path[:-1]:
        document = document[key]
    return document, path[-1]


def margin_names(funnel: Document) -> list[str]:
    return [name for name in (SECOND, METRE) if funnel[name] is not None]


def cells_of(document: Document) -> list[Document]:
    """Of all stretches: no list that the document holds."""
    return [cell for stretch in stretches_of(document) for cell in stretch["cells"]]


def stretches_of(document: Document, kind: int | None = None) -> list[Document]:
    """The list of one funnel's, or all of them in a list that the document does not hold."""
    proofs = document["hints"]["decrease"]
    return [own for proof in proofs for own in proof["stretches"]] if kind is None else proofs[kind]["stretches"]


def value_at(document: Any, path: tuple) -> Any:
    for key in path:
        document = document[key]
    return document


def is_number(text: str) -> bool:
    return text.lstrip("-")[:1].isdigit() and not text.startswith("sha256")


def renewed(document: Document) -> bytes:
    """The file with the hash of its content."""
    return json.dumps({**document, "hash": document_hash(document)}).encode()
