"""Several gaits: what each needs alone, put together, and one gait as it ever was."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import TABLE_I, Config, ExpertConfig, OtherGait
from surefoot.config.gait_table import GAITS
from surefoot.mpc.gaits import with_gaits
from surefoot.robots.bounds import joint_rows
from surefoot.robots.several_gaits import envelope, for_each_gait
from surefoot.scenarios.gaits import IDS_OF_A_GAIT, AllStarts, all_starts_of, gait_of
from surefoot.scenarios.starts import load_starts, save_starts, starts_of

STORED = load_starts()
BOUND = replace(STORED, gait=GAITS["bound"])


def several(tmp_path) -> Config:
    path = tmp_path / "bound.npz"
    save_starts(BOUND, path)
    other = OtherGait(GAITS["bound"], ExpertConfig(command_gain=(1.4, 1.2, 1.4)), str(path))
    return replace(Config(), other_gaits=(other,))


def test_a_function_is_given_each_gait_alone():
    config = with_gaits(Config(), ["trot", "walk", "bound"])
    seen = []

    def complete(one: Config) -> Config:
        seen.append(one)
        gain = (1.0 + len(seen), 1.0, 1.0)
        safety = replace(TABLE_I, roll_pitch=20.0 + len(seen))
        expert = replace(one.expert, command_gain=gain)
        return replace(one, expert=expert, start_set=f"set {len(seen)}", safety=safety)

    done = for_each_gait(complete, config)
    assert [one.gait for one in seen] == [GAITS[name] for name in ("trot", "walk", "bound")]
    assert not any(one.other_gaits for one in seen)
    assert done.start_set == "set 1"
    assert [other.start_set for other in done.other_gaits] == ["set 2", "set 3"]
    gains = [done.expert, *(other.expert for other in done.other_gaits)]
    assert [each.command_gain[0] for each in gains if each and each.command_gain] == [2, 3, 4]
    assert done.safety.roll_pitch == 23.0
    assert for_each_gait(lambda one: one, Config()) == Config()


def test_the_envelope_holds_every_bound():
    low = replace(TABLE_I, com_height=(0.1, 0.9), knee=(-150.0, 0.0))
    rows = tuple((-200.0 + n, 5.0) for n in range(12))
    own = replace(TABLE_I, joints=rows, roll_pitch=40.0, fall_height=(0.05, 2.5))
    both = envelope([TABLE_I, low, own])
    assert both.com_height == (0.1, 1.0)
    assert both.roll_pitch == 40.0
    assert both.fall_height == (0.05, 2.5)
    for joint, hull in enumerate(both.joints):
        of_all = [joint_rows(one)[joint] for one in (TABLE_I, low, own)]
        assert hull == (min(row[0] for row in of_all), max(row[1] for row in of_all))
    assert envelope([TABLE_I, TABLE_I]) == TABLE_I
    settled = [replace(TABLE_I, settled=(0.18, 6.0)), TABLE_I, replace(TABLE_I, settled=(0.2, 9.0))]
    assert envelope(settled).settled == (0.18, 9.0)


def test_initial_states_of_each_gait_have_ids_and_gaits_of_their_own(tmp_path):
    stored = all_starts_of(several(tmp_path))
    starts = stored.first("test", 10)
    assert starts.gait.tolist() == [0] * 10 + [1] * 10
    np.testing.assert_array_equal(starts.q[:10], STORED.first("test", 10).q)
    np.testing.assert_array_equal(starts.id[10:], starts.id[:10] + IDS_OF_A_GAIT)
    np.testing.assert_array_equal(gait_of(starts.id), starts.gait)
    phases = stored.phases(starts.id)
    # No phase of one gait is one of another.
    assert not set(phases[:10].tolist()) & set(phases[10:].tolist())
    np.testing.assert_array_equal(phases[:10], STORED.phases(starts.id[:10]))
    assert stored.phases(np.array([-1])).tolist() == [-1]
    assert stored.hash != STORED.hash
    assert stored.name == "solo12-trot-v1, bound"


def test_of_one_gait_they_are_those_of_its_set():
    stored = all_starts_of(Config())
    assert stored == AllStarts((STORED,))
    assert (stored.hash, stored.seed, stored.name) == (STORED.hash, STORED.seed, STORED.name)
    one = stored.first("select", 7)
    np.testing.assert_array_equal(one.id, STORED.first("select", 7).id)
    assert not one.gait.any()


def test_what_takes_one_set_refuses_several_gaits(tmp_path):
    with pytest.raises(ValueError, match=r"takes one gait, but .* has 2: trot, bound; use one of"):
        starts_of(several(tmp_path))
