"""The documentation site: Sphinx with MyST and Furo; `make docs` builds it into docs/_build.

The source folder is the root of the repository, so that a page has the same links here and on
GitHub: pages of docs/, the benchmarks, the examples and the changelog refer to each other.
"""

from __future__ import annotations

import re
from urllib.request import urlopen

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator
from typing_extensions import is_protocol

import surefoot

project = "surefoot"
author = "The surefoot developers"
copyright = "The surefoot developers; BSD-3-Clause"
version = surefoot.__version__
release = surefoot.__version__

root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "benchmarks/**",
    "examples/bridges/README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = [
    ".*",
    "checks",
    "docs/_build",
    "docs/_site",
    "dist",
    "results",
    "runs",
    "scripts",
    "src",
    "studies",
    "tests",
]
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]

# A link to a heading that does not exist is a warning, and a warning is an error.
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]

html_theme = "furo"
html_title = f"surefoot {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
# The start page of the site leads to docs/index.html.
html_extra_path = ["_site"]
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "mathml"
copybutton_exclude = ".linenos, .gp, .go"

# Docstrings write code in single backticks.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_class_signature = "mixed"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
# Docstrings give shapes and units; the types are in the signatures.
napoleon_attr_annotations = False
python_maximum_signature_line_length = 88
maximum_signature_line_length = 88

nitpicky = True
nitpick_ignore_regex = [
    # No network is needed to build the site, so that other packages' pages are not linked.
    ("py:.*", r"(collections|gymnasium|numpy|pathlib|pinocchio|socketserver|torch|typing)\..*"),
    # The sections `Raises` name exceptions without their modules.
    ("py:exc", r"\w+"),
    # Type variables, and names of types that stand for longer ones.
    ("py:class", r"surefoot\.runs\.run\.(Parameters|Record)|surefoot\.config\.checked\.Value"),
    ("py:class", r"Array|IntArray|NDArray|VelocityError|bool|int\d+|float\d+|str_|.*SeedSequence"),
    # The smallest and the largest value of a field of the configuration.
    ("py:class", r"-?[\d.]+(e[+-]?\d+)?"),
]
linkcheck_timeout = 20
linkcheck_anchors = False
ALL_SITES = r"https?://.*"
"""What is not checked where no network leads to other sites."""
PROBE = "https://semver.org"
"""One of them, small and likely to be there."""


def visit_math(translator: HTML5Translator, node: nodes.math) -> None:
    """Write a formula of a line as MathML, which browsers draw without any script."""
    translator.body.append(tex2mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def visit_math_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a displayed formula as MathML."""
    formula = tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div class="formula">{formula}</div>\n')
    raise nodes.SkipNode


def keep_colons(
    app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]
) -> None:
    """Keep napoleon from taking what stands before the first colon of an attribute for its type.

    It is told that the type is what stands before a colon at the very beginning: nothing.
    """
    if what in ("attribute", "data", "property") and lines:
        lines[0] = f": {lines[0]}"


def leave_out_other_sites(app: Sphinx) -> None:
    """Check the links to other sites only where a network leads to one of them.

    Links within the site are resolved by every builder; one that leads nowhere is a warning.
    """
    if app.builder.name != "linkcheck":
        return
    try:
        urlopen(PROBE, timeout=app.config.linkcheck_timeout).close()
    except OSError as error:
        print(f"links to other sites are not checked: {PROBE} cannot be reached ({error})")
        app.config.linkcheck_ignore = [ALL_SITES]


ARRAY = re.compile(
    r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?numpy\.(\w+)\]\]"
)
"""An array in a signature, as Sphinx writes it out."""


def shorten_signature(
    app: Sphinx,
    what: str,
    name: str,
    value: object,
    options: object,
    signature: str | None,
    result: str | None,
) -> tuple[str | None, str | None] | None:
    """Write arrays as the code does, and made defaults as Python; protocols have no arguments."""
    if isinstance(value, type) and is_protocol(value):
        return "", None
    # Sphinx cannot read a signature with this word in it, and takes it to pieces at each comma.
    parts = (signature and signature.replace("<factory>", "..."), result)
    short_signature, short_result = (part and ARRAY.sub(r"NDArray[\1]", part) for part in parts)
    return short_signature, short_result


def setup(app: Sphinx) -> None:
    """Register what draws the formulas, and what reads docstrings before napoleon does."""
    # Before the builder reads what it is to leave out.
    app.connect("builder-inited", leave_out_other_sites, priority=100)
    app.connect("autodoc-process-docstring", keep_colons, priority=400)
    app.connect("autodoc-process-signature", shorten_signature)
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))
