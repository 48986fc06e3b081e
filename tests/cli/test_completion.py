"""The scripts are valid, and complete commands, options, values and files as a shell does it."""

import shutil
import subprocess

import pytest

from surefoot.cli.arguments import option_sizes
from surefoot.cli.completion import completion_script, words_of
from surefoot.cli.main import COMMANDS
from surefoot.cli.train import Train

ASK = """
source {script}
COMP_WORDS=(surefoot {words})
COMP_CWORD={position}
_surefoot
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
CASES = [
    (("tra",), ["train"]),
    (("export",), ["export", "export-data"]),
    (("train", "--pre"), ["--preset"]),
    (("train", "--preset", "q"), ["quick"]),
    (("train", "loco_s"), ["loco_safe_dagger"]),
    (("train", "--track", ""), ["tensorboard", "wandb", "trackio"]),
    (("train", "--config.method.N-"), ["--config.method.N-query"]),
    (("walk", "--gait", "bo"), ["bound"]),
    (("walk", "--robot", "go"), ["go2", "go1"]),
    (("evaluate", "--sim", ""), ["mujoco", "bullet"]),
    (("bench", "end"), ["end_to_end"]),
    (("completion", "z"), ["zsh"]),
    (("study", "pa"), ["pause", "paper"]),
]
FILES = [("play", "runs"), ("train", "--run", "loco"), ("run", "--robot", "u")]
"""Where the shell completes names of files, as no word fits."""


def bash_answers(folder, words):
    script = folder / "surefoot.bash"
    script.write_text(completion_script("bash"))
    quoted = " ".join(f"'{word}'" for word in words)
    asked = ASK.format(script=script, words=quoted, position=len(words))
    child = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True)
    assert child.stderr == ""
    return child.stdout.split()


@pytest.mark.parametrize(("words", "answers"), CASES)
def test_bash_completes_commands_options_and_values(tmp_path, words, answers):
    assert bash_answers(tmp_path, words) == answers


@pytest.mark.parametrize("words", FILES)
def test_bash_completes_files_where_no_word_fits(tmp_path, words):
    assert bash_answers(tmp_path, words) == []
    assert "complete -o default -F _surefoot surefoot\n" in completion_script("bash")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_valid(tmp_path, surefoot, capsys, shell):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    assert surefoot("completion", shell) == 0
    script = tmp_path / "script"
    script.write_text(capsys.readouterr().out)
    subprocess.run([shell, "-n", script], check=True)


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
@pytest.mark.parametrize(("words", "answers"), CASES)
def test_fish_completes_commands_options_and_values(tmp_path, words, answers):
    script = tmp_path / "surefoot.fish"
    script.write_text(completion_script("fish"))
    asked = f"source {script}; complete -C 'surefoot {' '.join(words)}'"
    child = subprocess.run(["fish", "-c", asked], capture_output=True, text=True, check=True)
    assert set(answers) <= {line.split("\t")[0] for line in child.stdout.splitlines()}


def test_every_command_and_option_is_in_every_script():
    bash = completion_script("bash")
    fish = completion_script("fish")
    for name, entry in COMMANDS.items():
        assert f" {name}) words=" in bash
        assert f" -a {name} -d " in fish
        for option in option_sizes(entry.command):
            assert f"{option} " in bash
            assert f" -l {option[2:]}" in fish


def test_an_option_without_a_value_is_a_flag():
    words = words_of(Train, "")
    assert {"--resume", "--no-resume", "--config.method.no-all-frames", "--help"} <= words.flags
    assert not {"--run", "--preset", "--config.seed"} & words.flags


def test_zsh_reads_the_script_of_bash():
    zsh = completion_script("zsh")
    assert zsh.startswith("#compdef surefoot\n")
    assert zsh.endswith(completion_script("bash"))
    assert "bashcompinit" in zsh
