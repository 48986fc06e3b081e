"""The command make-starts, without the minutes that a set takes."""

import numpy as np
import pytest
import tyro

from surefoot.cli.make_starts import MakeStarts
from surefoot.config import Config, PerturbationConfig
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios import make
from surefoot.scenarios.starts import StartSet, load_starts


def command(*args) -> MakeStarts:
    kind = tyro.conf.AvoidSubcommands[MakeStarts]
    return tyro.cli(kind, args=[str(arg) for arg in args])


@pytest.fixture
def asked(monkeypatch) -> list:
    """What was asked of the function that makes sets."""
    calls = []

    def fake(name, config, perturbation, seed) -> StartSet:
        calls.append((name, config, perturbation, seed))
        stored = load_starts()
        return StartSet(name, stored.grid, stored.shape)

    monkeypatch.setattr(make, "make_starts", fake)
    return calls


def test_a_set_is_made_and_written(asked, tmp_path, capsys):
    out = tmp_path / "wide.npz"
    assert command(out, "--scale", "1.5")() == 0
    ((name, config, perturbation, seed),) = asked
    assert (name, config, seed) == ("wide", with_own_values(Config()), make.SEED)
    assert perturbation.joint_position == pytest.approx(0.3)
    assert perturbation.max_penetration == PerturbationConfig().max_penetration
    back = load_starts(out)
    assert back.hash == load_starts().hash
    assert back.name == "wide"
    printed = capsys.readouterr().out
    count = sum(int(np.prod(shape)) for shape in back.shape.values())
    assert f"{out}: {count} initial states, hash {back.hash}" in printed


def test_seed_and_simulator_are_handed_on(asked, tmp_path):
    command(tmp_path / "a.npz", "--seed", "5", "--sim", "bullet")()
    ((_, config, _, seed),) = asked
    assert (config.simulation.backend, seed) == ("bullet", 5)


def test_an_existing_set_is_refused_before_any_work(asked, tmp_path):
    out = tmp_path / "a.npz"
    out.write_bytes(b"precious")
    with pytest.raises(FileExistsError, match="never changed: use a new name"):
        command(out)()
    assert asked == []
    assert out.read_bytes() == b"precious"
