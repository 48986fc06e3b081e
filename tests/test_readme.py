"""The programs in the README run as they stand there."""

import re
from ast import literal_eval
from pathlib import Path

import pytest

from surefoot import Outcome

README = Path(__file__).parent.parent / "README.md"
PROGRAMS = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("number", range(len(PROGRAMS)))
def test_program_runs(number, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(PROGRAMS[number], f"README.md, program {number}", "exec"), {"__name__": "readme"})
    outcomes = literal_eval(capsys.readouterr().out.strip().splitlines()[-1])
    assert len(outcomes) == 20
    if number == 0:  # as its last comment says: a plan that holds a pose stands still
        assert set(outcomes) == {"STALLED"}
    else:
        assert set(outcomes) <= {outcome.name for outcome in Outcome}
