"""Tables of experiments: a list of dataclass objects as CSV and as Markdown."""

import csv
import dataclasses
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cfjax.report.files import write_whole


def markdown(lines: Sequence[Any], without: Sequence[str] = ("seconds",)) -> str:
    """One column per field, four digits; fields in `without` (those that no two runs share) are left out."""

    def cell(value: object) -> str:
        nothing = value is None or (isinstance(value, float) and math.isnan(value))
        return "–" if nothing else f"{value:.4g}" if isinstance(value, float) else str(value)

    names = [field.name for field in dataclasses.fields(lines[0]) if field.name not in without] if lines else []
    rows = [" | ".join(cell(getattr(line, name)) for name in names) for line in lines]
    head = [" | ".join(name.replace("_", " ") for name in names), " | ".join("---" for _ in names)]
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
