"""What a robot, a gait and a box need: measured once, kept whole, refused with numbers."""

import json
from dataclasses import replace

import numpy as np
import pytest

import surefoot.files
from surefoot.config import (
    TABLE_I,
    CommandBox,
    Config,
    DisturbanceConfig,
    ExpertConfig,
    PerturbationConfig,
    RobotConfig,
    SafetyConfig,
    SimulationConfig,
    TrainingConfig,
)
from surefoot.config.checked import known
from surefoot.config.expert_rules import TROT_GAIN
from surefoot.config.json_io import to_json
from surefoot.config.profiles import ODRI
from surefoot.config.robot_table import GO2
from surefoot.config.single_gaits import each_gait
from surefoot.mpc.gaits import with_gait, with_gaits
from surefoot.mpc.schedule import stands
from surefoot.robots.geometry import state_of
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values
from surefoot.runs.earlier_values import with_values_of
from surefoot.safety.gates import tightened, unsafe
from surefoot.scenarios import prepare as module
from surefoot.scenarios.gains import measured_gain
from surefoot.scenarios.make import SEED, SIZES, cycle_instants, make_starts, settle
from surefoot.scenarios.prepare import (
    completed,
    prepare,
    prepared_key,
    with_preparation,
)
from surefoot.scenarios.settled_bounds import settled_bounds
from surefoot.scenarios.starts import load_starts, starts_of
from surefoot.scenarios.walking import GaitError, Walks
from tests.fakes.walks import SMALL, FakeWalks, fake_walks

__all__ = ["fake_walks"]
GO2_TROT = Config(robot=RobotConfig("go2"), commands=CommandBox(vx=(-0.2, 0.6)))
PERTURBATION = PerturbationConfig()


def made(config: Config = GO2_TROT) -> module.Prepared:
    return prepare(config, sizes=SMALL)


def kept_files(tmp_path, kind: str = "prepared") -> list:
    return list((tmp_path / "cache" / "surefoot").glob(f"{kind}/*"))


def test_what_is_prepared_is_made_once_and_found_again(fake_walks, tmp_path):
    first = made()
    assert not first.kept
    assert first.made.command_gain == pytest.approx((1.25, 1.25, 1.25))
    assert first.path.stem == first.made.key
    assert [path.name for path in kept_files(tmp_path)] == [first.path.name]
    assert (len(first.starts["nominal"]), len(first.starts["train"])) == (30, 60)
    asked = len(fake_walks.asked)
    again = made()
    assert again.kept
    assert (again.starts.hash, again.made) == (first.starts.hash, first.made)
    assert len(fake_walks.asked) == asked


def test_robots_begin_at_the_commands_of_the_box_and_reach_them_with_the_gains(fake_walks):
    first = made()
    np.testing.assert_array_equal(first.starts.commands("nominal"), GO2_TROT.commands.spread(3))
    np.testing.assert_allclose(first.made.tracking_error, 0.0, atol=1e-4)


def test_what_is_prepared_is_of_the_robot_the_gait_and_the_description(fake_walks):
    starts = made().starts
    assert starts.robot == "go2"
    assert starts.name.startswith("go2-trot-")
    other = replace(GO2, foot_radius=0.03)
    with pytest.raises(ValueError, match="belong to another description of the robot go2"):
        starts_of(replace(GO2_TROT, robot=RobotConfig(spec=other), start_set=str(made().path)))


CHANGES = {
    "robot": replace(GO2_TROT, robot=RobotConfig("a1")),
    "spec": replace(GO2_TROT, robot=RobotConfig(spec=replace(GO2, foot_radius=0.03))),
    "limit": replace(GO2_TROT, robot=RobotConfig("go2", torque_limit=20.0)),
    "gait": with_gait(GO2_TROT, "walk"),
    "height": replace(GO2_TROT, gait=replace(GO2_TROT.gait, com_height=0.28)),
    "box": replace(GO2_TROT, commands=CommandBox(vx=(-0.2, 0.7))),
    "expert": replace(GO2_TROT, expert=ExpertConfig(kp=30.0)),
    "gain": replace(GO2_TROT, expert=ExpertConfig(command_gain=(1.0, 1.0, 1.0))),
    "simulator": replace(GO2_TROT, simulation=SimulationConfig(backend="bullet")),
    "friction": replace(GO2_TROT, simulation=SimulationConfig(friction=0.7)),
    "falls": replace(GO2_TROT, safety=SafetyConfig(fall_angle=40.0)),
}


def key(config=GO2_TROT, perturbation=PERTURBATION, seed=SEED, sizes=SIZES) -> str:
    return prepared_key(with_own_values(config), perturbation, seed, sizes)


@pytest.mark.parametrize("name", CHANGES)
def test_the_key_changes_with_each_ingredient(name):
    assert key(CHANGES[name]) != key()


def test_the_key_changes_with_the_perturbation_the_seed_and_the_sizes():
    wide = replace(PERTURBATION, velocity=0.3)
    keys = {key(), key(perturbation=wide), key(seed=1), key(sizes=SMALL)}
    assert len(keys) == 4


def test_the_key_changes_with_the_code_and_the_versions_of_the_planner(monkeypatch):
    before = key()
    with monkeypatch.context() as patch:
        patch.setattr("surefoot.scenarios.keys.code_hash", lambda: "other")
        assert key() != before
    monkeypatch.setattr("surefoot.scenarios.keys._version", lambda name: "0")
    assert key() != before


def test_the_key_changes_with_the_content_of_the_description_but_not_with_its_place(tmp_path):
    from surefoot.robots.description import find_urdf

    content = find_urdf(GO2).read_bytes()
    paths = [tmp_path / "a.urdf", tmp_path / "b.urdf", tmp_path / "c.urdf"]
    for path, text in zip(paths, (content, content, content + b"<!-- -->"), strict=True):
        path.write_bytes(text)
    keys = [
        key(replace(GO2_TROT, robot=RobotConfig(spec=replace(GO2, urdf=str(path)))))
        for path in paths
    ]
    assert keys[0] == keys[1] != keys[2]


def test_the_key_changes_with_the_content_of_the_profile_but_not_with_its_place(tmp_path):
    keys = []
    for number, torque in enumerate((20.0, 20.0, 5.0)):
        profile = replace(ODRI, robot="go2", torque_limit=(torque,) * 3)
        file = tmp_path / f"{number}.json"
        file.write_text(json.dumps(to_json(profile)))
        keys.append(key(replace(GO2_TROT, robot=RobotConfig("go2", profile=str(file)))))
    assert key() != keys[0] == keys[1] != keys[2]


def test_the_key_takes_no_notice_of_what_has_no_part_in_it():
    assert key(replace(GO2_TROT, seed=7, chunk=3)) == key()


def test_a_killed_preparation_leaves_nothing_half(fake_walks, tmp_path, monkeypatch):
    def killed(*_):
        raise SystemExit

    with monkeypatch.context() as patch:
        patch.setattr(surefoot.files.Path, "unlink", lambda *_, **__: None)
        patch.setattr(module, "make_starts", killed)
        with pytest.raises(SystemExit):
            made()
    assert kept_files(tmp_path) == []
    asked = len(fake_walks.asked)
    with monkeypatch.context() as patch:
        patch.setattr(surefoot.files.Path, "unlink", lambda *_, **__: None)
        patch.setattr(surefoot.files.os, "replace", killed)
        with pytest.raises(SystemExit):
            made()
    assert all(path.name.endswith(".tmp") for path in kept_files(tmp_path))
    assert len(fake_walks.asked) == asked + 1  # the gains were kept
    assert not made().kept
    assert made().kept


def test_what_another_process_has_prepared_meanwhile_is_kept(fake_walks, monkeypatch):
    others = []

    def overtaken(*arguments):
        monkeypatch.setattr(module, "make_starts", make_starts)
        other = made()
        others.append((other, other.path.stat().st_ino))
        return make_starts(*arguments)

    monkeypatch.setattr(module, "make_starts", overtaken)
    mine = made()
    other, file = others[0]
    assert mine.kept and not other.kept
    assert mine.path.stat().st_ino == file
    assert mine.starts.hash == other.starts.hash


@pytest.mark.parametrize("content", [b"", b"PK", b"x" * 1000])
def test_a_damaged_file_is_made_again(fake_walks, content):
    first = made()
    first.path.write_bytes(content)
    again = made()
    assert not again.kept
    assert again.starts.hash == first.starts.hash


def test_a_file_under_another_name_is_made_again(fake_walks):
    first = made()
    other = made(CHANGES["box"])
    first.path.write_bytes(other.path.read_bytes())
    assert made().starts.hash == first.starts.hash


def test_damaged_gains_are_measured_again(fake_walks, tmp_path):
    robot = load_robot("go2")
    first = measured_gain(robot, GO2_TROT)
    [path] = kept_files(tmp_path, "gains")
    path.write_text("{")
    assert measured_gain(robot, GO2_TROT) == first


def test_a_box_that_is_too_large_is_refused_with_the_largest_that_works(fake_walks):
    fake_walks.limit = 0.5
    config = replace(GO2_TROT, commands=CommandBox(vx=(-0.3, 1.0), yaw_rate=(-0.5, 0.5)))
    text = (
        r"the gait trot does not walk go2 at these commands: of 3 .* it survives 2 for 3 s, and "
        r"falls at .* 1, 0, 0\. The largest box that works: --vx -0\.3 0\.4 --vy 0 0 --yaw-rate "
        r"-0\.5 0\.5"
    )
    with pytest.raises(GaitError, match=text) as refused:
        made(config)
    assert refused.value.largest == CommandBox(vx=(-0.3, 0.4), yaw_rate=(-0.5, 0.5))


def test_a_gait_that_falls_while_its_gains_are_measured_is_told_which_box_works(fake_walks):
    fake_walks.limit = 0.21  # Go2 is told 0.24 m/s
    with pytest.raises(GaitError, match="The largest box that works") as refused:
        made()
    largest = refused.value.largest
    assert largest == CommandBox(vx=(-0.2, 0.12))
    assert not made(replace(GO2_TROT, commands=largest)).made.gain.told[0] > 0.2


@pytest.mark.parametrize("period", [0.5, 0.52, 0.612, 1.02])
def test_what_is_followed_is_a_mean_over_whole_periods_on_the_grid_or_off_it(fake_walks, period):
    prepared = made(replace(GO2_TROT, gait=replace(GO2_TROT.gait, period=period)))
    for each in prepared.made.followed:
        assert each.velocity == pytest.approx(each.command, abs=1e-3)
    assert max(prepared.made.tracking_error) < 1e-3


def test_a_gait_that_falls_on_the_spot_is_refused(fake_walks):
    fake_walks.limit = -1.0
    with pytest.raises(GaitError, match="It falls on the spot, too: use another gait"):
        made()
    given = replace(GO2_TROT, expert=ExpertConfig(command_gain=(1.0, 1.0, 1.0)))
    with pytest.raises(GaitError, match="It falls on the spot, too: use another gait") as refused:
        made(given)
    assert refused.value.largest is None


def test_a_command_at_which_a_robot_falls_gives_its_place_to_the_nearest(fake_walks, monkeypatch):
    monkeypatch.setattr("surefoot.scenarios.boxes.LEAST_SURVIVED", 0.5)
    fake_walks.limit = 0.5
    prepared = made()
    commands = prepared.starts.commands("nominal")
    np.testing.assert_allclose(commands[:, 0], [-0.2, 0.2, 0.2])
    fell = {each.command[0]: each.fell for each in prepared.made.followed}
    assert fell == {-0.2: False, 0.2: False, 0.6: True}


# --- bounds


@pytest.fixture(scope="module")
def trot() -> Walks:
    """Go2 trots in simulation, settled."""
    config = with_own_values(GO2_TROT)
    config = replace(config, expert=replace(config.expert, command_gain=(1.07, 1.04, 1.21)))
    command = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [-0.2, 0.1, 0.3], [0.3, 0.1, -0.3]])
    walks = settle(config, command)
    return walks.since(int(cycle_instants(config.gait)[0]))


def test_a_settled_gait_never_fires_its_bounds(trot):
    robot = load_robot("go2")
    own = with_own_values(GO2_TROT).safety
    bounds = settled_bounds(robot, own, trot.of(np.array([True, True, True, False])))
    state = state_of(robot, trot.q.reshape(-1, 19), trot.v.reshape(-1, 18))
    assert not unsafe(state, bounds).any()  # at the command that was left out, neither
    tight = tightened(bounds, 0.01, known(with_own_values(GO2_TROT).gait.com_height, "height"))
    assert not unsafe(state, tight).any()
    lowest = known(bounds.com_height, "com_height")[0]
    assert lowest <= known(own.com_height, "com_height")[0]
    for (low, high), (lower, higher) in zip(own.joints, bounds.joints, strict=True):
        assert lower <= low and high <= higher


def test_bounds_are_widened_by_ten_degrees_and_two_centimeters_where_a_gait_needs_it():
    robot = load_robot("solo12")
    walks = FakeWalks()(robot, with_own_values(Config()), np.zeros((1, 3)), 3)
    walks.q[1, 0, 7] = np.radians(80.0)
    walks.q[:, :, 2] -= 0.12
    bounds = settled_bounds(robot, TABLE_I, walks)
    assert bounds.joints[0] == pytest.approx((-30.0, 90.0))
    assert bounds.joints[1:] == ((0.0, 90.0), (-160.0, 0.0), *bounds.joints[3:])
    state = state_of(robot, walks.q[:, 0], walks.v[:, 0])
    assert bounds.com_height == pytest.approx((state.com[:, 2].min() - 0.02, 1.0), abs=2e-4)
    assert bounds.roll_pitch == TABLE_I.roll_pitch


def test_the_bounds_of_a_gait_within_the_papers_table_are_the_papers():
    robot = load_robot("solo12")
    walks = FakeWalks()(robot, with_own_values(Config()), np.zeros((1, 3)), 3)
    bounds = settled_bounds(robot, TABLE_I, walks)
    assert replace(bounds, settled=None) == TABLE_I
    height = state_of(robot, walks.q[:, 0], walks.v[:, 0]).com[0, 2]
    assert bounds.settled == pytest.approx((height - 0.01, 5.0), abs=1e-4)


# --- whole configurations


def test_the_packaged_set_needs_no_measuring(monkeypatch):
    monkeypatch.setattr(module, "prepare", None)  # not to be called
    config = completed(Config())
    assert config.start_set == "solo12-trot-v1"
    assert config.expert.command_gain == TROT_GAIN
    assert config.safety == TABLE_I
    assert completed(config) == config


@pytest.fixture
def small_sets(fake_walks, monkeypatch) -> FakeWalks:
    whole = module.prepare
    monkeypatch.setattr(module, "prepare", lambda config: whole(config, sizes=SMALL))
    return fake_walks


def test_a_gait_that_stands_is_completed_without_commands_only(small_sets):
    standing = with_gait(GO2_TROT, "stand")
    with pytest.raises(GaitError, match="the gait stand goes nowhere, but the commands are --vx"):
        completed(standing)
    config = completed(replace(standing, commands=CommandBox((0.0, 0.0))))
    assert config.expert.command_gain == (1.0, 1.0, 1.0)
    completed(with_gaits(GO2_TROT, ["trot", "stand"]))


def test_a_robot_that_stands_among_other_gaits_does_as_it_is_told(fake_walks, monkeypatch, caplog):
    """It stands whatever the command is, so that no smaller box would help."""
    walk = module.settle

    def still(config, commands):
        walks = walk(config, commands)
        return replace(walks, v=np.zeros_like(walks.v)) if stands(config.gait) else walks

    monkeypatch.setattr(module, "settle", still)
    config = with_gaits(replace(GO2_TROT, commands=CommandBox((0.0, 0.3))), ["trot", "stand"])
    made = prepare(each_gait(config)[1], sizes=SMALL).made
    assert made.commands.vx == (0.0, 0.3)
    assert made.astray == () and max(made.tracking_error) < 1e-3
    assert "does not walk as it is told" not in caplog.text


def test_a_gait_that_does_not_walk_as_it_is_told_is_warned_of(fake_walks, monkeypatch, caplog):
    prepare(GO2_TROT, sizes=SMALL)
    assert "does not walk as it is told" not in caplog.text
    walk = module.settle

    def backwards(config, commands):
        walks = walk(config, commands)
        astray = walks.command[:, 0] > 0.5
        return replace(walks, v=np.where(astray[:, None], -walks.v, walks.v))

    monkeypatch.setattr(module, "settle", backwards)
    made = prepare(GO2_TROT, seed=1, sizes=SMALL).made
    assert made.astray
    assert f"at {len(made.astray)} of {len(made.followed)} commands" in caplog.text


def test_joints_beyond_their_limits_are_warned_of_by_name(fake_walks, monkeypatch, caplog):
    prepare(GO2_TROT, sizes=SMALL)
    assert "limit" not in caplog.text
    walk = module.settle

    def beyond(config, commands):
        walks = walk(config, commands)
        fast = walks.command[:, 0] > 0.5
        walks.v[:, fast, 6 + 2] = -1.2 * 15.7
        walks.q[:, fast, 7 + 5] = -0.8
        return walks

    monkeypatch.setattr(module, "settle", beyond)
    prepare(GO2_TROT, seed=1, sizes=SMALL)
    assert (
        "go2, trot: at 1 of 3 commands a joint is faster than its motor; at (vx, vy, yaw rate) "
        "0.60, 0.00, 0.00 FL_KFE ('FL_calf_joint' in the URDF) turns at up to 120% of its speed "
        "limit, 15.7 rad/s. Use a smaller box of commands"
    ) in caplog.text
    assert (
        "in the settled gait, in 33.3 % of the time a joint is beyond its position limits, most of "
        "all FR_KFE ('FR_calf_joint' in the URDF) at -0.80 rad, where -2.72 to -0.84 are allowed"
    ) in caplog.text


def test_another_robot_gets_what_was_measured_and_all_of_it(small_sets):
    config = completed(GO2_TROT)
    stored = starts_of(config)
    assert stored.preparation is not None
    assert config.expert.command_gain == stored.preparation.command_gain
    assert config.safety.joints == stored.preparation.safety.joints
    assert config.expert.turn_compensation == 0.3
    assert completed(config) == config


def test_values_that_are_given_are_heard_even_if_they_are_a_default_elsewhere(small_sets):
    safety = SafetyConfig(com_height=(0.15, 1.0), hip_flexion=(0.0, 90.0))
    expert = ExpertConfig(command_gain=TROT_GAIN)
    config = completed(replace(GO2_TROT, safety=safety, expert=expert))
    assert config.expert.command_gain == TROT_GAIN
    assert config.safety.com_height == (0.15, 1.0)
    assert config.safety.joints[1] == (0.0, 90.0)
    assert config.safety.joints[7] == (0.0, 90.0)  # Go2's legs bend alike


def test_a_range_of_one_joint_leaves_what_the_settled_gait_needs_of_the_others(small_sets):
    whole = completed(GO2_TROT).safety.joints
    hip = completed(replace(GO2_TROT, safety=SafetyConfig(hip_abduction=(-20.0, 50.0)))).safety
    assert hip.joints[0] == (-20.0, 50.0)
    assert hip.joints[3] == (-50.0, 20.0)
    assert [row for i, row in enumerate(hip.joints) if i % 3] == [
        row for i, row in enumerate(whole) if i % 3
    ]


def test_states_of_other_commands_are_warned_of_and_keep_their_rules(small_sets, caplog):
    turns = CommandBox((-0.2, 0.2), yaw_rate=(-0.2, 0.2))
    path = completed(Config(commands=turns)).start_set
    config = completed(Config(start_set=path))
    assert "were made for --vx -0.2 0.2 --vy 0 0 --yaw-rate -0.2 0.2, but the comm" in caplog.text
    assert config.expert.turn_compensation == 0.3


def test_gains_of_another_expert_than_that_of_the_states_are_warned_of(small_sets, caplog):
    path = str(completed(GO2_TROT).start_set)
    gains = ExpertConfig(command_gain=(1.0, 1.0, 1.0))
    config = completed(replace(GO2_TROT, start_set=path, expert=gains))
    assert config.expert.command_gain == (1.0, 1.0, 1.0)
    assert "but the initial states were made with (1.25, 1.25, 1.25)" in caplog.text


def test_a_file_of_initial_states_brings_its_gains_and_bounds(small_sets, monkeypatch):
    whole = completed(GO2_TROT)
    monkeypatch.setattr(module, "prepare", None)
    assert completed(replace(GO2_TROT, start_set=whole.start_set)) == whole


def test_what_a_run_has_measured_is_kept_when_it_goes_on(small_sets, monkeypatch):
    whole = completed(GO2_TROT)
    monkeypatch.setattr(module, "prepare", None)
    assert with_values_of(GO2_TROT, whole) == whole
    other = with_values_of(replace(GO2_TROT, safety=SafetyConfig(roll_pitch=20.0)), whole)
    assert other.safety.roll_pitch == 20.0


def test_a_run_of_an_earlier_version_goes_on_with_the_numbers_that_it_has(small_sets):
    whole = completed(GO2_TROT)
    earlier = replace(
        whole,
        safety=replace(TABLE_I, joints=whole.safety.joints),
        push=replace(whole.push, resolution=0.2),
        collection=replace(whole.collection, impulse=(0.3, 1.5)),
    )
    none = DisturbanceConfig(impulse=None)
    assert with_values_of(replace(GO2_TROT, collection=none), earlier) == earlier
    joints = SafetyConfig(joints=whole.safety.joints)
    assert with_values_of(replace(GO2_TROT, safety=joints), earlier).safety == earlier.safety
    other = replace(GO2_TROT, safety=SafetyConfig(knee=(-150.0, 0.0)))
    assert with_values_of(other, earlier).safety != earlier.safety


GIVEN = {
    "range": replace(GO2_TROT, safety=SafetyConfig(knee=(-150.0, 0.0))),
    "joints": replace(GO2_TROT, safety=SafetyConfig(joints=((-90.0, 90.0),) * 12)),
    "gains": replace(GO2_TROT, expert=ExpertConfig(kp=30.0, command_gain=(1.0, 1.0, 1.0))),
    "height": replace(GO2_TROT, gait=replace(GO2_TROT.gait, com_height=0.28)),
    "limit": replace(GO2_TROT, robot=RobotConfig("go2", torque_limit=20.0)),
    "terrain": replace(GO2_TROT, simulation=SimulationConfig(terrain="slope:5")),
    "seed": replace(GO2_TROT, training=TrainingConfig(seed=3)),
}


@pytest.mark.parametrize("name", GIVEN)
def test_what_was_given_at_first_need_not_be_given_again(small_sets, name):
    whole = completed(GIVEN[name])
    assert with_values_of(GIVEN[name], whole) == whole
    assert with_values_of(GO2_TROT, whole) == whole


def test_initial_states_that_were_given_at_first_need_not_be_given_again():
    whole = replace(with_own_values(Config()), start_set="mine.npz")
    assert with_values_of(Config(), whole) == whole


def test_another_robot_is_not_taken_for_that_of_the_run(small_sets):
    spec = replace(GO2, name="mine")
    whole = completed(replace(GO2_TROT, robot=RobotConfig("mine", spec=spec)))
    assert with_values_of(GO2_TROT, whole).robot != whole.robot


def test_a_preparation_survives_its_file(fake_walks):
    prepared = made()
    assert load_starts(prepared.path).preparation == prepared.made
    config = with_preparation(replace(GO2_TROT, start_set=str(prepared.path)), prepared.made)
    assert config.commands == prepared.made.commands
