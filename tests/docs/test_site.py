"""Tests of the documentation site: it builds without warnings, loads nothing from other hosts, and contains the
reference."""

import re
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import urlsplit

import pytest

from servoloop.cli import PANELS
from tests.pages import ROOT, pages
from tests.view.chromium import find_chromium

pytestmark = pytest.mark.slow

FETCHED = ("link", "script", "img", "iframe", "source", "video", "audio", "object", "embed", "use", "form")
"""Elements with addresses that a browser loads without a click."""
ELSEWHERE = re.compile(r"(?:url\(\s*['\"]?|@import\s+['\"])(https?:)?//")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the site as built by ``make docs``."""
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False, timeout=110.0)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class Page(HTMLParser):
    """Addresses that a page loads, and its paragraphs."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.paragraphs: list[str] = []
        self.classes: set[str] = set()
        self._within = False
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.classes |= {name for key, value in attrs if key == "class" for name in (value or "").split()}
        if tag in FETCHED:
            self.fetched += [value or "" for key, value in attrs if key in ("src", "href", "srcset", "data", "action")]
        if tag == "p":
            self.paragraphs.append("")
        self._within = tag == "p" or (self._within and tag != "li")

    def handle_endtag(self, tag: str) -> None:
        self._within = self._within and tag != "p"

    def handle_data(self, data: str) -> None:
        if self._within and self.paragraphs:
            self.paragraphs[-1] += data


def html(site: Path) -> list[Path]:
    return sorted(site.rglob("*.html"))


def test_every_page_is_on_the_site(site: Path) -> None:
    for page in pages():
        if page != "README.md":
            name = re.sub(r"README\.md$", "index.md", page)
            assert (site / name).with_suffix(".html").is_file(), page


def test_no_page_loads_files_from_another_host(site: Path) -> None:
    for path in html(site):
        page = Page(path)
        assert [link for link in page.fetched if urlsplit(link).netloc] == [], path
        assert "mermaid" not in page.classes, "Material would fetch a library for it"
    for path in site.rglob("*.css"):
        assert not ELSEWHERE.search(path.read_text()), path


def test_lists_and_tables_are_rendered(site: Path) -> None:
    """A list without a preceding empty line is a list on git hosts but running text on the site."""
    for path in html(site):
        for text in Page(path).paragraphs:
            assert not re.search(r"^(- |\d+\. |\|)", text, re.MULTILINE), (path.name, text[:200])


def test_the_reference_has_every_command_and_every_name_of_its_tables(site: Path) -> None:
    commands = (site / "reference" / "cli.html").read_text()
    for verb in [verb for group in PANELS.values() for verb in group]:
        assert f"servoloop {verb}" in commands, verb
    for page in ("python", "tools", "tests"):
        names = re.findall(r"^\| `([\w.]+)` \|", pages()[f"reference/{page}.md"].read_text(), re.MULTILINE)
        shown = (site / "reference" / f"{page}.html").read_text()
        assert names and [name for name in names if f'id="{name}"' not in shown] == []


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None: ...


@pytest.fixture
def address(site: Path) -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site))) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("from_disk", [False, True])
def test_a_browser_uses_only_this_machine_and_the_search_finds_words(site: Path, address: str, from_disk: bool) -> None:
    from playwright.sync_api import sync_playwright

    requests: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=["--no-sandbox"])
        page = browser.new_page()
        page.on("request", lambda request: requests.append(request.url))
        root = site.as_uri() if from_disk else address
        page.goto(f"{root}/index.html")
        # Type one key after the other, because the search reads its field at each key release.
        page.locator("input.md-search__input").press_sequentially("gravity compensation")
        found = page.wait_for_selector(".md-search-result__item a")
        assert found is not None and (found.get_attribute("href") or "").startswith(f"{root}/")
        page.goto(f"{root}/architecture.html")
        browser.close()
    assert {urlsplit(url).hostname for url in requests} == {None if from_disk else "127.0.0.1"}, requests
