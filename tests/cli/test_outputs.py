"""The files that a command is to write: they replace nothing that anything else needs."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from surefoot.cli.main import parse
from surefoot.cli.outputs import Output, check_option, check_outputs, film_outputs
from surefoot.cli.walk import Walk
from surefoot.config.json_io import to_json
from surefoot.config.robot_table import GO2
from surefoot.config.studies import named_study
from surefoot.files import write_json
from surefoot.robots.description import find_urdf
from surefoot.study.folder import StudySetup, save_setup
from surefoot.study.layout import STUDY_FILE


@dataclass(frozen=True)
class Nothing:
    """A command without options."""


def test_an_option_that_is_not_given_is_not_checked():
    check_option("--json", None)


def test_a_film_and_the_sheet_beside_it_can_both_be_written(tmp_path):
    check_outputs(Nothing(), film_outputs("--out", tmp_path / "film.mp4"))
    (tmp_path / "film.png").mkdir()
    with pytest.raises(ValueError, match=r"--out \(its contact sheet\): .*film.png' is a folder"):
        check_outputs(Nothing(), film_outputs("--out", tmp_path / "film.mp4"))
    check_outputs(Nothing(), film_outputs("--out", Path("/dev/null")))  # nothing is beside a device


@pytest.mark.parametrize("name", ["film.mp4", "film.png", "./film.png", "link.json"])
def test_two_outputs_that_are_one_file_are_refused(monkeypatch, tmp_path, name):
    monkeypatch.chdir(tmp_path)
    Path("link.json").symlink_to("film.mp4")
    film = film_outputs("--out", tmp_path / "film.mp4")
    with pytest.raises(ValueError, match=r"--out.* is the file of --json too.*name another file"):
        check_outputs(Nothing(), [Output("--json", Path(name)), *film])
    check_outputs(Nothing(), [Output("--json", Path("film.json")), *film])


def test_two_outputs_may_go_to_one_device():
    check_outputs(
        Nothing(), [Output("--json", Path("/dev/null")), Output("--out", Path("/dev/null"))]
    )


def test_an_output_does_not_replace_what_the_command_reads(tmp_path):
    policy = tmp_path / "policy.safetensors"
    with pytest.raises(ValueError, match=r"--json: .* is what the command reads too"):
        check_outputs(Nothing(), [Output("--json", policy)], reads=[policy])


def test_an_output_does_not_replace_a_file_of_a_run_that_is_to_begin(tmp_path):
    with pytest.raises(ValueError, match=r"--json: .* is one of the run's own files in"):
        check_outputs(
            Nothing(), [Output("--json", tmp_path / "run/policies/a.json")], (), tmp_path / "run"
        )
    check_outputs(Nothing(), [Output("--json", tmp_path / "run/report.json")], (), tmp_path / "run")


@pytest.mark.parametrize(
    "words",
    [
        "evaluate --profile FILE",
        "evaluate --starts FILE",
        "compare runs/a --profile FILE",
        "compare runs/a --starts FILE",
        "play --profile FILE",
        "play --robot FILE",
        "walk --robot FILE",
        "walk --profile FILE",
        "walk --config.robot.model FILE",
        "train behavior_cloning --robot FILE",
        "train behavior_cloning --config.start-set FILE",
        "train behavior_cloning --config.robot.profile FILE",
        "learn --robot udp://127.0.0.1:5151 --config.start-set FILE",
        "prepare --robot FILE",
        "survey --robots solo12 FILE",
        "bench plan --robot FILE",
        "bench expert --config.robot.profile FILE",
        "terrains FILE",
        "gate-warnings FILE",
        "robot FILE",
        "check FILE",
        "check a.onnx --log FILE",
        "run FILE --robot udp://127.0.0.1:5151",
        "study status FILE",
        "study FILE --estimate",
    ],
)
def test_no_command_replaces_a_file_that_one_of_its_options_names(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    file = Path("mine.json")
    write_json(file, to_json(named_study("smoke")))
    before = file.read_bytes()
    command = parse([*words.replace("FILE", str(file)).split(), "--json", "./mine.json"])
    if words == "play --robot FILE":  # it is for a flight, which has no report
        with pytest.raises(ValueError, match="--robot is for a recording"):
            command()
    else:
        with pytest.raises(ValueError, match=r"--json: mine.json is what the command reads too"):
            command()
    assert file.read_bytes() == before


def test_no_command_replaces_the_description_that_a_robots_file_names(tmp_path):
    urdf = tmp_path / "mine.urdf"
    shutil.copy(find_urdf(GO2), urdf)
    file = tmp_path / "mine.json"
    write_json(file, to_json(replace(GO2, urdf="mine.urdf")))
    for command in ("robot FILE", "prepare --robot FILE", "walk --robot FILE"):
        words = [*command.replace("FILE", str(file)).split(), "--json", str(urdf)]
        with pytest.raises(ValueError, match=r"--json: .* is what the command reads too"):
            parse(words)()


def test_an_export_does_not_replace_the_profile_that_it_reads(tmp_path):
    file = tmp_path / "profile.onnx"
    file.write_text("{}")
    with pytest.raises(ValueError, match=r"--onnx: .* is what the command reads too"):
        parse(["export", "--profile", str(file), "--onnx", str(file)])()


def test_a_name_of_the_package_is_no_file_that_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_outputs(Walk(robot="go2", profile="odri"), [Output("--json", Path("go2"))])


def test_an_output_does_not_replace_a_file_of_a_study(tmp_path):
    save_setup(tmp_path, StudySetup(named_study("smoke"), None, "0", "float32"))
    for name in ("study.json", "judged.json", "estimate.json", "a/seed-0/jobs/done.json"):
        output = Output("--json", tmp_path / name)
        with pytest.raises(ValueError, match=r"--json: .* is one of the study's own files in"):
            check_outputs(Nothing(), [output])
    check_outputs(Nothing(), [Output("--json", tmp_path / "mine.json")])
    page = tmp_path / "report.html"
    check_outputs(Nothing(), [Output("--out (its page)", page, is_own=True)])


def test_an_output_does_not_replace_a_file_of_a_study_that_is_to_begin(tmp_path):
    output = Output("--json", tmp_path / STUDY_FILE)
    check_outputs(Nothing(), [output])
    with pytest.raises(ValueError, match=r"--json: .* is one of the study's own files in"):
        check_outputs(Nothing(), [output], new_study=tmp_path)
