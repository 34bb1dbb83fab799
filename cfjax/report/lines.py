"""Tables of experiments: a list of dataclass objects as CSV and as Markdown.

A field whose figures are proven says so: `certified: float | None = field(metadata=AT_LEAST)` is rounded down,
`half_width: float = field(metadata=AT_MOST)` up, so that no table claims more than what is proven.
"""

import csv
import dataclasses
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cfjax.report.files import write_whole
from cfjax.rounded import NOTHING, margin_text, rounded_up


AT_LEAST = {"text": margin_text}  # margins, and what is absorbed
AT_MOST = {"text": rounded_up}  # half-widths of a funnel


def markdown(lines: Sequence[Any], without: Sequence[str] = ("seconds",)) -> str:
    """One column per field, four digits; fields in `without` (those that no two runs share) are left out."""

    def cell(value: object, field: dataclasses.Field[Any]) -> str:
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return NOTHING
        return field.metadata.get("text", "{:.4g}".format)(value) if isinstance(value, float) else str(value)

    fields = [field for field in dataclasses.fields(lines[0]) if field.name not in without] if lines else []
    rows = [" | ".join(cell(getattr(line, field.name), field) for field in fields) for line in lines]
    head = [" | ".join(field.name.replace("_", " ") for field in fields), " | ".join("---" for _ in fields)]
    return "\n".join(f"| {row} |" for row in [*head, *rows]) + "\n"


def write_lines(lines: Sequence[Any], folder: Path, name: str) -> None:
    """Write name.csv (full precision) and name.md into the folder, each whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    file = io.StringIO()
    writer = csv.DictWriter(file, [field.name for field in dataclasses.fields(lines[0])], lineterminator="\n")
    writer.writeheader()
    writer.writerows(dataclasses.asdict(line) for line in lines)
    write_whole(folder / f"{name}.csv", file.getvalue().encode())
    write_whole(folder / f"{name}.md", markdown(lines).encode())
