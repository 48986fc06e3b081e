"""Every command of the documentation is understood by the command line.

`make test-docs` also runs those that stand in blocks, but for those with a reason not to: a comment
`not run` before the block, or a form in `NOT_RUN`.
"""

import re
import shlex
import subprocess
import sys
from contextlib import contextmanager
from functools import cache

import numpy as np
import pytest

from surefoot.cli.arguments import sort_arguments
from surefoot.cli.main import COMMANDS, parse
from surefoot.methods.behavior_cloning import behavior_cloning
from surefoot.runs.run import create
from surefoot.workers import Workers
from tests.docs.pages import BLOCKS, PAGES, ROOT, relative, text_without_blocks
from tests.fakes.small_runs import CLONING

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
TUTORIAL = "docs/tutorial.md"
"""The page whose commands, trainings too, are run as they stand, which takes minutes."""
TWIN = "docs/your-hardware.md"
"""The page with the twin, which takes a second terminal."""
OWN_TEST = (TUTORIAL, TWIN)
"""The pages whose commands a test of their own runs."""
EXTENDING = "docs/extending.md"
"""The page whose reader has a run and a log."""
NOT_RUN = {
    r"demo": "It takes minutes; .ci/run runs it, as `make demo`.",
    r"train (?!.*--help)": "Trainings take minutes to hours; that of the tutorial is run.",
    r"(evaluate|play|gate-warnings) runs/": "It needs the training before it.",
    r"(prepare|survey|terrains|compare|study) ": "Such measurements take minutes to days.",
    r"learn ": "It takes half an hour on a twin, and more on a robot.",
    r"twin .*--lockstep": "It is the robot of `surefoot learn`.",
    r"view": "It serves a page until it is stopped; `make test-pages` opens one.",
}
"""Why commands of some forms are not run; whatever else stands in a block is."""
SHORTER = {
    "evaluate": ("--episodes", "2", "--no-expert"),
    "fit": ("--epochs", "1"),
    "play": ("--seconds", "0.1"),
    "run": ("--start", "--seconds", "3", "--lockstep"),
    "twin": ("--lockstep",),
    "walk": ("--seconds", "2", "--no-video"),
}
"""What makes commands take seconds only; without a lockstep, a busy machine misses ticks, and a
policy that is hardly trained falls after 0.2 s."""


@cache
def understands(*words):
    """Whether the command line takes these words; a mistake in them ends the test.

    Pages have many of the commands in common, and each is read once.
    """
    try:
        parse(words)
    except SystemExit as stop:  # after help
        return not stop.code
    return True


def reason_of(words):
    """Why a command is not run; empty if it is."""
    text = " ".join(words[1:])
    return next((why for form, why in NOT_RUN.items() if re.match(form, text)), "")


def commands_of(page):
    """The commands of a page that are to be run, in their order."""
    return [
        words
        for block, words in LINES
        if (block.page, words[0], block.mark) == (page, "surefoot", "") and not reason_of(words)
    ]


def shortened(words, port=5151):
    """A command as it is run: shorter, and with a port that is free."""
    # The policy that comes with the package stands for one of the reader's own.
    words = [word.replace("5151", str(port)) for word in words if word != "RUN"]
    return [*words, *SHORTER.get(words[1], ())]


@contextmanager
def serving(words, folder):
    """A context with a twin, which is ended with it; the value is the port where it listens."""
    command = [sys.executable, "-m", *words]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as twin:
        try:
            assert twin.stdout is not None
            yield int(twin.stdout.readline().rpartition(":")[2])
        finally:
            twin.kill()


def run(words, folder):
    """What a command prints; it has to succeed."""
    command = [sys.executable, "-m", *words]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert result.returncode == 0, f"{' '.join(words)}\n{result.stdout}\n{result.stderr}"
    return result.stdout


def put_robots(page, folder):
    """Write the robots that a page describes, each under its name."""
    for block in BLOCKS:
        if block.page == page and block.language == "toml":
            (name,) = re.findall(r'^name = "(\w+)"$', block.text, flags=re.MULTILINE)
            (folder / f"{name}.toml").write_text(block.text)


def put_run_and_log(folder):
    """Make a small run, as runs/first, and write its episodes as the log of an expert."""
    run = create(folder / "runs" / "first", CLONING)
    behavior_cloning(run, workers=Workers(1))
    frames = run.dataset.load()
    names = ("q", "v", "torque", "command", "tick")
    np.savez(folder / "log.npz", **{name: getattr(frames, name) for name in names})


@pytest.mark.parametrize(
    ("block", "words"),
    [each for each in LINES if each[1][0] == "surefoot"],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_a_command_in_a_block_is_understood(block, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert understands(*words[1:]), block


@pytest.mark.parametrize(("page", "code"), INLINE)
def test_a_command_in_a_sentence_is_understood(page, code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name, *rest = [PLACEHOLDERS.get(word, word) for word in shlex.split(code)]
    if name == "--help":
        assert understands(name)
        return
    assert name in COMMANDS, page
    if page == "CHANGELOG.md":  # it names old options, too
        return
    options = sort_arguments(rest, COMMANDS[name].command)
    assert options.unknown == (), page
    if rest and not ABRIDGED.search(code):
        assert understands(name, *rest), page


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


def test_every_reason_not_to_run_a_command_is_needed():
    texts = [" ".join(words[1:]) for _, words in LINES if words[0] == "surefoot"]
    assert [form for form in NOT_RUN if not any(re.match(form, text) for text in texts)] == []


@pytest.mark.documented
@pytest.mark.parametrize(
    "page", [page for page in map(relative, PAGES) if page not in OWN_TEST and commands_of(page)]
)
def test_the_commands_of_a_page_run(page, tmp_path):
    put_robots(page, tmp_path)
    if page == EXTENDING:
        put_run_and_log(tmp_path)
    for words in commands_of(page):
        run(shortened(words), tmp_path)


@pytest.mark.documented
def test_the_policy_of_the_package_drives_the_twin(tmp_path):
    export, check, twin, drive = commands_of(TWIN)
    run(shortened(export), tmp_path)
    run(shortened(check), tmp_path)
    with serving(shortened(twin, port=0), tmp_path) as port:
        report = run(shortened(drive, port), tmp_path)
    assert re.search(r'^fault +""$', report, flags=re.MULTILINE), report


@pytest.mark.slow
def test_the_commands_of_the_tutorial_run_one_after_the_other(tmp_path):
    lines = [
        words
        for block, words in LINES
        if block.page == TUTORIAL and words[0] == "surefoot" and not block.mark
    ]
    printed = [run(words, tmp_path) for words in lines]
    assert "surefoot is ready" in printed[0]
    assert (tmp_path / "walk.mp4").is_file()
    assert (tmp_path / "runs" / "first" / "report.html").is_file()
    assert (tmp_path / "first.onnx").is_file()
