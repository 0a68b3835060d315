"""Hooks of mkdocs for the documentation site, so that the pages of docs/ also work on git hosts.

- A link from docs/ to another file in the repository leads to a page that shows this file.
- reference/cli.md contains the `--help` of all commands. The other pages of reference/ contain the docstrings of the
  names in their tables.
"""

import os
import posixpath
import re
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from typer.cli import get_docs_for_click

ROOT = Path(__file__).resolve().parents[1]
COMMANDS = "reference/cli.md"
SHOWN = "repository"
"""Folder of the site with the pages that show other files of the repository."""
LINK = re.compile(r"(?<=\]\()(\.\./[^)#\s]+)(?=\))")
NAMED = re.compile(r"^\| `([a-z_]+(?:\.\w+)+)` \|", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each file outside docs/ that a page links to."""
    shown: dict[str, Path] = {}
    for file in files.documentation_pages():
        for link in LINK.findall(Path(str(file.abs_src_path)).read_text()):
            if target := _outside(file, link, config):
                shown[_page_of(target)] = target
    for name, path in shown.items():
        page = File.generated(config, name, content=_text(path), inclusion=InclusionLevel.NOT_IN_NAV)
        files.append(page)
    return files


def on_page_markdown(markdown: str, page: Any, config: MkDocsConfig, files: Files) -> str:
    """Redirect links to files outside docs/ to those pages, and fill the reference."""

    def inside(link: re.Match[str]) -> str:
        target = _outside(page.file, link[1], config)
        return os.path.relpath(_page_of(target), posixpath.dirname(page.file.src_uri) or ".") if target else link[1]

    markdown = LINK.sub(inside, markdown)
    if page.file.src_uri == COMMANDS:
        return markdown + _commands()
    if page.file.src_uri.startswith("reference/"):
        names = NAMED.findall(markdown)
        linked = NAMED.sub(lambda found: f"| [`{found[1]}`][{found[1]}] |", markdown)
        return linked + "".join(f"\n::: {name}\n" for name in names)
    return markdown


def _outside(file: File, link: str, config: MkDocsConfig) -> Path | None:
    """Return the file or folder outside docs/ to which a link of a page leads, if any."""
    docs = Path(config.docs_dir)
    target = (docs / posixpath.dirname(file.src_uri) / link).resolve()
    return target if target.exists() and not target.is_relative_to(docs) else None


def _page_of(target: Path) -> str:
    return f"{SHOWN}/{target.relative_to(ROOT)}.md"


def _text(path: Path) -> str:
    """Return the text of a page that shows a file, or all files of a folder."""
    parts = [f"# {path.relative_to(ROOT)}\n"]
    for one in sorted(path.iterdir()) if path.is_dir() else [path]:
        if one.is_file():
            language = "python" if one.suffix == ".py" else ""
            parts.append((f"## {one.name}\n\n" if path.is_dir() else "") + f"````{language}\n{one.read_text()}\n````\n")
    return "\n".join(parts)


def _commands() -> str:
    """Return the help of all commands, as typer formats it."""
    from servoloop.cli import app

    group = typer.main.get_command(app)
    text = get_docs_for_click(obj=group, ctx=typer.Context(group), name="servoloop")
    return "\n" + text.partition("\n")[2]
