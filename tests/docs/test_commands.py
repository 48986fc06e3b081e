"""Every command of the documentation is understood by the command line; many are run."""

import re
import shlex
import subprocess
import sys

import pytest

from surefoot.cli.arguments import sort_arguments
from surefoot.cli.main import COMMANDS, parse
from tests.docs.pages import BLOCKS, PAGES, ROOT, relative, text_without_blocks

LINES = [(block, words) for block in BLOCKS for words in block.commands]
INLINE = [
    (relative(page), code)
    for page in PAGES
    for code in re.findall(r"`(?:\.venv/bin/)?surefoot\s+([^`]+)`", text_without_blocks(page))
]
PLACEHOLDERS = {"SIM": "mujoco", "METHOD": "dagger", "V": "0.2", "ID": "17"}
"""What the words stand for that cannot be the name of a file or of a folder."""
ABRIDGED = re.compile(r"\.\.|…|\||\[")
"""Commands in sentences may leave something out, or name alternatives."""
CHEAP = {
    "docs/export.md": ("export", "check"),
    "docs/your-hardware.md": ("export", "check"),
    "docs/your-robot.md": ("robot",),
}
"""The commands that are run often, by page: they take seconds."""


def understands(words):
    """Whether the command line takes these words; a mistake in them ends the test."""
    try:
        parse(words)
    except SystemExit as stop:  # after help
        return not stop.code
    return True


def run(words, folder):
    """What a command prints; it has to succeed."""
    command = [sys.executable, "-m", *words]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert result.returncode == 0, f"{' '.join(words)}\n{result.stdout}\n{result.stderr}"
    return result.stdout


@pytest.mark.parametrize(
    ("block", "words"),
    [each for each in LINES if each[1][0] == "surefoot"],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_a_command_in_a_block_is_understood(block, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert understands(words[1:]), block


@pytest.mark.parametrize(("page", "code"), INLINE)
def test_a_command_in_a_sentence_is_understood(page, code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name, *rest = [PLACEHOLDERS.get(word, word) for word in shlex.split(code)]
    if name == "--help":
        assert understands([name])
        return
    assert name in COMMANDS, page
    if page == "CHANGELOG.md":  # it names old options, too
        return
    options = sort_arguments(rest, COMMANDS[name].command)
    assert options.unknown == (), page
    if rest and not ABRIDGED.search(code):
        assert understands([name, *rest]), page


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_the_targets_of_make_exist(page):
    inline = re.findall(r"`make ([a-z-]+)", text_without_blocks(page))
    blocks = [
        words[1] for block, words in LINES if (block.page, words[0]) == (relative(page), "make")
    ]
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert sorted({*inline, *blocks} - {*targets}) == []


@pytest.mark.parametrize(
    ("block", "words"), [each for each in LINES if each[1][0] not in ("surefoot", "make")]
)
def test_a_command_of_another_program_is_known(block, words):
    program, *rest = words
    if program == "pip":
        pins = (ROOT / "constraints.txt").read_text().splitlines()
        assert [word for word in rest if "==" in word and word not in pins] == []
    elif program.startswith("python"):
        assert rest[0] == "-m" or (ROOT / rest[0]).is_file()
    else:
        assert block.mark == "not run", f"{program} is no program that this test knows"


@pytest.mark.documented
@pytest.mark.parametrize("page", CHEAP)
def test_the_cheap_commands_of_a_page_run(page, tmp_path):
    for block in BLOCKS:
        if block.page == page and block.language == "toml":
            (name,) = re.findall(r'^name = "(\w+)"$', block.text, flags=re.MULTILINE)
            (tmp_path / f"{name}.toml").write_text(block.text)
    lines = [words for block, words in LINES if block.page == page and words[1] in CHEAP[page]]
    assert lines
    for words in lines:
        # The policy that comes with the package stands for one of the reader's own.
        run([word for word in words if word != "RUN"], tmp_path)


@pytest.mark.slow
def test_the_commands_of_the_tutorial_run_one_after_the_other(tmp_path):
    lines = [
        words
        for block, words in LINES
        if block.page == "docs/tutorial.md" and words[0] == "surefoot" and not block.mark
    ]
    printed = [run(words, tmp_path) for words in lines]
    assert "surefoot is ready" in printed[0]
    assert (tmp_path / "walk.mp4").is_file()
    assert (tmp_path / "runs" / "first" / "report.html").is_file()
    assert (tmp_path / "first.onnx").is_file()
