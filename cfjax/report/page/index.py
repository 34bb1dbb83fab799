"""index.html of a sweep: its jobs with verdicts and margins, each a link to the report of its own."""

from pathlib import Path

from cfjax.report.files import REPORT, write_whole
from cfjax.report.page.page import environment, text_of
from cfjax.report.page.tables import margin, number
from cfjax.report.table import gather


INDEX = "index.html"


def write_index(sweep: Path) -> Path:
    """Write the index page of a sweep, finished or not, and return its path."""
    rows = gather(sweep)
    counts: dict[str, int] = {}
    for row in rows:
        counts[row.verdict] = counts.get(row.verdict, 0) + 1
    margins = [abs(margin) for row in rows for margin in (row.certified, row.falsified) if margin is not None]
    text = (
        environment()
        .get_template("index.html.j2")
        .render(
            name=sweep.resolve().name,
            rows=rows,
            links={row.job: f"{row.folder}/{REPORT}" for row in rows if (sweep / row.folder / REPORT).exists()},
            counts=counts,
            largest=max(margins, default=1.0) or 1.0,
            paper=any(row.paper for row in rows),
            number=number,
            shown=margin,
            style=text_of("page.css"),
            own=text_of("index.css"),
        )
    )
    path = sweep / INDEX
    write_whole(path, text.encode())
    return path
