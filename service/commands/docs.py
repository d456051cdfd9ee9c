"""`truepose docs`: the documentation of this installation, in the browser or the terminal."""

from __future__ import annotations

import webbrowser
from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer
from rich.markdown import Markdown

from calib.errors import DataError
from calib.text import did_you_mean
from service.printed.terminal import Terminal

SOURCES = Path(__file__).parents[2] / "docs"
INSTALLED = "share/truepose/docs/index.md"
SITE = "build/index.html"


def docs_command(
    page: Annotated[
        str, typer.Argument(metavar="PAGE", help="Show this page in the terminal, e.g. first-hour.")
    ] = "",
    where: Annotated[
        bool, typer.Option("--where", help="Print the path of the pages, and open nothing.")
    ] = False,
) -> None:
    """Open the documentation. If it was not built as a site, its pages are listed."""
    folder = pages_folder()
    site = folder / SITE
    with Terminal() as terminal:
        if page:
            terminal.out.print(Markdown(_page(folder, page).read_text("utf-8")))
        elif site.is_file() and not where:
            typer.echo(site)
            webbrowser.open(site.as_uri())
        else:
            typer.echo(f"{folder}: Markdown, one file a page; 'truepose docs PAGE' shows one here.")
            typer.echo(", ".join(names(folder)))


def pages_folder() -> Path:
    """Return the folder of the pages, in the sources or in the wheel.

    Raises
    ------
    DataError
        The installation has no pages.
    """
    if (SOURCES / "index.md").is_file():
        return SOURCES
    for path in metadata.files("truepose") or ():
        if path.as_posix().endswith(INSTALLED):
            return Path(str(path.locate())).resolve().parent
    raise DataError(
        "the pages did not come with this installation.", do="See the folder docs of the sources."
    )


def names(folder: Path) -> list[str]:
    """Return the pages in alphabetical order, as `truepose docs PAGE` takes them.

    Decisions are left out, and the evidence, which no wheel contains.
    """
    found = (path.relative_to(folder) for path in folder.rglob("*.md"))
    return sorted(
        path.with_suffix("").as_posix()
        for path in found
        if path.parts[0] not in ("decisions", "evidence", "made", "build")
    )


def _page(folder: Path, name: str) -> Path:
    """Return the file of a page by its name, or by the end of its name.

    Raises
    ------
    DataError
        No page, or several, have this name.
    """
    found = [each for each in names(folder) if each == name or each.endswith(f"/{name}")]
    if len(found) != 1:
        raise DataError(
            f"there is no page '{name}'.",
            do=f"{did_you_mean(name, names(folder))}There are {', '.join(names(folder))}.",
            key="PAGE",
        )
    return folder / f"{found[0]}.md"
