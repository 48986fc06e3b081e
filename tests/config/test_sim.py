"""Ranges of the simulators' configuration."""

import pytest

from surefoot.config import Config, SimulationConfig
from surefoot.config.json_io import from_json, to_json
from surefoot.config.sim import Terrain, parse_terrains


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (SimulationConfig, {"friction": 0.0}, "simulation.friction is 0.0; use 0.001 to 10.0"),
        (SimulationConfig, {"solref": (0.001, 1.0)}, "simulation.solref[0] is 0.001; use 0.002"),
        (SimulationConfig, {"solref": (0.004, 0.0)}, "simulation.solref[1] is 0.0; use 0.01 to"),
        (SimulationConfig, {"backend": "mujco"}, "there is no simulation.backend 'mujco'; did you"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)


def test_terrains_are_read_from_a_text():
    assert parse_terrains("flat") == (Terrain("flat"),)
    assert parse_terrains("bumps:0.03") == (Terrain("bumps", 0.03, 0.03),)
    assert parse_terrains("slope:0..10, stairs:.02@7,blocks:1e-2..5e-2") == (
        Terrain("slope", 0.0, 10.0),
        Terrain("stairs", 0.02, 0.02, 7),
        Terrain("blocks", 0.01, 0.05),
    )
    assert SimulationConfig(terrain="bumps:0.03").terrains == (Terrain("bumps", 0.03, 0.03),)
    assert SimulationConfig().terrains == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "terrain '': write a kind and its size, such as bumps:0.03"),
        ("bumps:0.03,", "terrain '': write a kind"),
        ("bumps", "terrain 'bumps': bumps needs a size"),
        ("flat:1", "terrain 'flat:1': flat has no size"),
        ("rocks:1", "there is no terrain 'rocks'; did you mean 'blocks'?"),
        ("bumps:-0.1", "terrain bumps: size -0.1; use 0 to 0.3 m"),
        ("bumps:5", "terrain bumps: size 5; use 0 to 0.3 m"),
        ("slope:90", "terrain slope: size 90; use 0 to 45 deg"),
        ("bumps:nan", "terrain.low is nan; use a finite number"),
        ("bumps:0.01..inf", "terrain.high is inf; use a finite number"),
        ("bumps:0.05..0.01", "terrain bumps: sizes 0.05 to 0.01; the first must not exceed"),
        ("bumps:0.01-0.05", "terrain 'bumps:0.01-0.05': its size is no number"),
        ("bumps:0.1@-1", "terrain 'bumps:0.1@-1': write a kind"),
        ("bumps:0.1@9999999999", "terrain.seed is 9999999999; use 0 to 2147483647"),
        (",".join(["flat"] * 33), "33 terrains; use at most 32"),
        ("x" * 100_000, "terrain 'xxxxx"),
    ],
)
def test_a_terrain_that_there_is_not_is_refused(text, message):
    with pytest.raises(ValueError) as error:
        SimulationConfig(terrain=text)
    assert str(error.value).startswith(message)
    assert len(str(error.value)) < 400


def test_a_terrain_of_one_size_is_one_of_its_range():
    terrain = Terrain("slope", 0.0, 10.0, seed=3)
    assert terrain.of_size(4.0) == Terrain("slope", 4.0, 4.0, seed=3)


def test_a_terrain_is_kept_in_a_file_and_older_files_have_none():
    config = Config(simulation=SimulationConfig(terrain="bumps:0.01..0.05"))
    values = to_json(config)
    assert values["simulation"]["terrain"] == "bumps:0.01..0.05"
    assert from_json(Config, values) == config
    del values["simulation"]["terrain"]
    assert from_json(Config, values) == Config()
