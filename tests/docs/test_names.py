"""Every path, module, name and option that the documents mention exists."""

import ast
import re
from dataclasses import fields
from importlib import import_module

import pytest

import surefoot
from surefoot.config import Config
from surefoot.config.methods import METHODS
from tests.docs.pages import PAGES, ROOT, relative

PACKAGE = ROOT / "src" / "surefoot"
MODULES = sorted(PACKAGE.rglob("*.py"))


documents = pytest.mark.parametrize("document", PAGES, ids=relative)


def text_of(document):
    """Text of a document; of a row in the changelog's tables the last cell, the others are old."""
    text = document.read_text()
    if document.name == "CHANGELOG.md":
        text = re.sub(r"^ *\|.*\|(.*)\|$", r"\1", text, flags=re.MULTILINE)
    return text


def code_in(text):
    """The pieces of code in a text: in backticks, and the lines of blocks that are not Python."""
    blocks = re.findall(r"^ *```(\w*)\n(.*?)^ *```$", text, flags=re.DOTALL | re.MULTILINE)
    without_blocks = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
    pieces = re.findall(r"`([^`]+)`", without_blocks)
    for language, block in blocks:
        if language != "python":
            pieces += block.splitlines()
    return pieces


def missing_paths(pieces, folders):
    """Paths of modules, documents and folders that exist in none of these folders."""
    words = [word for piece in pieces for word in piece.split()]
    paths = [word for word in words if re.fullmatch(r"\w[\w.-]*(/[\w.-]+)*(\.py|\.md|/)", word)]
    return [path for path in paths if not any((folder / path).exists() for folder in folders)]


def resolves(dotted):
    """Whether a dotted name is a module or an attribute of one."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        try:
            value = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            value = getattr(value, part, None)
        return value is not None
    return False


def option_exists(option):
    """Whether a dotted option such as `method.gates` belongs to the config of any method."""
    values = [Config(method=method()) for method in METHODS.values()]
    for part in option.replace("-", "_").split("."):
        values = [getattr(value, part) for value in values if hasattr(value, part)]
    return bool(values)


@documents
def test_paths_exist(document):
    folders = [ROOT, PACKAGE, PACKAGE / "deploy", document.parent]
    assert missing_paths(code_in(text_of(document)), folders) == []


@documents
def test_links_lead_somewhere(document):
    for path, anchor in re.findall(r"\]\(([^)#:]*)(#[^)]*)?\)", text_of(document)):
        target = document.parent / path if path else document
        assert target.exists(), path
        if anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), flags=re.MULTILINE)
            words = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
            assert anchor[1:] in [word.replace(" ", "-") for word in words]


@documents
def test_modules_and_public_names_exist(document):
    text = text_of(document)
    dotted = {
        name for piece in code_in(text) for name in re.findall(r"\bsurefoot(?:\.\w+)+", piece)
    }
    assert [name for name in sorted(dotted) if not resolves(name)] == []
    public = set(re.findall(r"\bsf\.(\w+)", text))
    assert sorted(public - set(surefoot.__all__)) == []


@documents
def test_options_exist(document):
    if document.name == "CHANGELOG.md":
        pytest.skip("it names old options, too")
    sections = "|".join(field.name for field in fields(Config))
    option = rf"(?<![\w./])(?:--config\.)?((?:{sections})(?:\.[a-zA-Z][\w-]*)+)"
    code = "\n".join(code_in(text_of(document)))
    options = re.findall(option, code.replace("--disturbance", "evaluation.disturbance"))
    files = r".*\.(py|md|npz|json|mp4|safetensors|urdf)"
    options = [name for name in options if not re.fullmatch(files, name)]
    assert [name for name in options if not option_exists(name)] == []


@pytest.mark.parametrize("module", MODULES, ids=relative)
def test_docstrings_name_modules_that_exist(module):
    pieces = []
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            pieces += re.findall(r"`([^`\n]+)`", str(node.value.value))
    assert missing_paths(pieces, [ROOT, PACKAGE, module.parent]) == []
    dotted = {name for piece in pieces for name in re.findall(r"\bsurefoot(?:\.\w+)+", piece)}
    assert [name for name in sorted(dotted) if not resolves(name)] == []
