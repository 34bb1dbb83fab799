"""A hook of mkdocs: the notebooks with their outputs, as `scripts/docs` has executed them, and a page that lists them.

The page is `experiments/notebooks/README.md`; each notebook that its table names and that is there becomes a download.
"""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files


FOLDER = Path(__file__).parents[1] / "experiments" / "notebooks"
PAGE = "notebooks.md"
ROW = re.compile(r"^\| `(\w+)` \|", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    files.append(File.generated(config, PAGE, content=page((FOLDER / "README.md").read_text("utf-8"))))
    for notebook in sorted(FOLDER.glob("*.ipynb")):
        files.append(File.generated(config, f"notebooks/{notebook.name}", abs_src_path=str(notebook)))
    return files


def page(readme: str) -> str:
    """The README with links to the notebooks that are there."""

    def link(row: re.Match[str]) -> str:
        name = f"{row[1]}.ipynb"
        return f"| [{name}](notebooks/{name}){{ download }} |" if (FOLDER / name).exists() else row[0]

    return ROW.sub(link, readme)
