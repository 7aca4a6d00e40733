"""The pages as a site: `make docs`. Sphinx with MyST, which reads the pages as they are, and the theme Furo.

The source folder is the repository, so a page's links are the same here and in the checkout. Nothing is fetched,
neither to build the site nor to read it.
"""

from __future__ import annotations

import html
import json
import re
import shutil
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

# Sphinx imports what it hasn't yet as a type checker would, and pydantic can't work with names that exist only there.
import srl.calibrating
import srl.client
import srl.links
import srl.simulation
import srl.testing
import srl.twins

ROOT = Path(__file__).parents[1]

project = "srl"
author = "the authors of srl-runtime"
version = release = srl.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "README"
include_patterns = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs/**"]
exclude_patterns = [".*", "out", "build", "tests", "bench", "runtime", "drivers", "sim", "studies", "srl"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # a page may leave out a level of headings
html_theme = "furo"
html_title = f"srl {version}"
html_copy_source = False
html_static_path = ["site.css", "versions.js"]
html_js_files = ["versions.js"]
html_css_files = ["site.css"]
highlight_language = "none"  # a block without a language is what a terminal shows
default_role = "code"  # docstrings put code between single backticks
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_numpy_docstring = False
napoleon_use_ivar = True


# The side bar. Each page of docs/ is in one of them (tests/test_docs.py).
GROUPS = {
    "Start": ["install", "half-hour", "so101", "profiles", "commands", "compared"],
    "Safety": ["safety", "guard", "collision"],
    "Worn limbs": [
        "worn-arm", "skeleton", "independent-operation", "intention", "ikns-finger", "strap-base",
        "feedback",
    ],
    "Control laws": ["signal-laws", "object-mapping", "ikns", "super-man", "arm-laws", "whole-body-qp", "compiled"],
    "Set up and calibrate": [
        "calibrate", "calibrate-glove", "calibrate-servos", "calibrate-suit", "calibrate-emg", "calibrate-frames",
        "jog", "capture-systems", "arm-angles", "frames",
    ],
    "Simulate": ["simulation", "twins", "robots", "simulated-person"],
    "See and record": ["panel", "picture", "recordings", "participant-screen", "foxglove", "lsl"],
    "Other programs": ["bus", "ros2"],
    "Run as a service": ["deployment"],
    "Extend and test": ["own-law", "extending", "extending-calibration", "testing"],
    "Studies": ["user-studies"],
    "How it is built": ["architecture", "dependencies"],
}  # fmt: skip


def _contents(caption: str, pages: list[str]) -> str:
    return "\n```{toctree}\n:hidden:\n:caption: " + caption + "\n\n" + "\n".join(pages) + "\n```\n"


def add_contents(_: Sphinx, document: str, content: list[str]) -> None:
    """Adds what the site's side bar needs, which would only disturb whoever reads the page in the checkout."""
    if document == "README":
        more = {
            "Start": ["docs/devices/README"],
            "Studies": ["docs/studies/README"],
            "How it is built": ["docs/api", "docs/decisions/README"],
        }
        for caption, pages in GROUPS.items():
            content[0] += _contents(caption, [*(f"docs/{page}" for page in pages), *more.get(caption, [])])
        content[0] += _contents("Project", ["CHANGELOG", "CONTRIBUTING"])
    elif document.endswith("/README"):
        others = sorted(page.stem for page in (ROOT / document).parent.glob("*.md") if page.stem != "README")
        content[0] += _contents("Pages", others)


def add_front_page(app: Sphinx, error: Exception | None) -> None:
    """Gives servers the name that they look for, and lists the versions that are side by side."""
    if error is None and app.builder.name == "html":
        shutil.copy(app.outdir / "README.html", app.outdir / "index.html")
        site = app.outdir.parent
        found = [page.parent.name for page in site.glob("*/README.html")]
        found.sort(key=lambda name: [int(number) for number in re.findall(r"\d+", name)], reverse=True)
        (site / "versions.list.js").write_text(f"srlVersions = {json.dumps(found)};\n")
        (site / "index.html").write_text(f'<meta http-equiv="refresh" content="0; url={found[0]}/index.html">\n')


def mend_page(
    _app: Sphinx, _name: str, _template: str, context: dict[str, Any], doctree: nodes.document | None
) -> None:
    """What the theme leaves out: levels of headings, what scrolls reached by keys, a description, an icon."""
    if tree := context.get("furo_navigation_tree"):
        context["furo_navigation_tree"] = tree.replace('role="heading"', 'role="heading" aria-level="2"')
    if body := context.get("body"):
        body = body.replace("<pre>", '<pre tabindex="0">')
        context["body"] = body.replace('<div class="table-wrapper', '<div tabindex="0" class="table-wrapper')
    first = next(iter(doctree.findall(nodes.paragraph)), None) if doctree is not None else None
    about = f'<meta name="description" content="{html.escape(first.astext()[:300])}">' if first is not None else ""
    context["metatags"] = f'{context.get("metatags", "")}{about}<link rel="icon" href="data:,">'


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("html-page-context", mend_page, priority=900)
    app.connect("source-read", add_contents)
    app.connect("build-finished", add_front_page)
