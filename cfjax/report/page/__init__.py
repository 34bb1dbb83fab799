"""report.html: one page that shows a run, opens offline and asks nobody for anything; and the index of a sweep."""

from typing import TYPE_CHECKING

from cfjax.lazy import on_first_use


if TYPE_CHECKING:
    from cfjax.report.page.index import write_index
    from cfjax.report.page.page import save_page, write_report


__all__ = ["save_page", "write_index", "write_report"]

__getattr__ = on_first_use(__name__)
