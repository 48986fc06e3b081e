"""DART on the toy: noise fitted to the learner's error, clean labels, the expert drives alone."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from surefoot.learning.policy import load, target_of
from surefoot.learning.samples import held_out
from surefoot.methods.dart import learner_error
from surefoot.rollouts.jobs import chunks_of, play_out, run_chunk
from surefoot.runs.budget import solves_of
from surefoot.runs.checks import check_config
from surefoot.runs.layout import RunError
from surefoot.runs.run import create
from tests.fakes import toy
from tests.fakes.runs import collected
from tests.fakes.toy_runs import CONFIG, LIMIT, METHODS, answers, collection, run_method

pytestmark = pytest.mark.usefixtures("toys")


def torque_errors(run, i):
    """(n, 12) pi_i's torque minus the expert's, in the held-out frames of D up to iteration i."""
    policy = load(run.policy_path(i))
    frames = run.dataset.before(100_000 * (i + 1)).load()
    frames = frames[held_out(frames.episode, CONFIG.training.validation)]
    everywhere = np.ones(len(frames), bool)
    torque = policy.torque(frames.state, frames.tick, frames.command, everywhere)
    np.testing.assert_allclose(  # and its label is the one that gives the expert's torque
        policy.spec.kp * (target_of(frames.torque, frames.q, frames.v, policy.spec))
        - policy.spec.kp * frames.q[:, 7:]
        - policy.spec.kd * frames.v[:, 6:],
        frames.torque,
        atol=1e-9,
    )
    return torque - frames.torque


@pytest.mark.parametrize("i", [0, 1])
def test_the_covariance_is_that_of_the_learners_error_on_held_out_frames(runs, i):
    run = runs("dart")
    error = torque_errors(run, i)
    expected = error.T @ error / len(error)
    np.testing.assert_allclose(learner_error(run, i), expected, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("i", [1, 2])
def test_the_noise_of_an_iteration_has_the_covariance_of_the_policy_before(runs, i):
    run = runs("dart")
    job = collection(run, i)
    assert job.episodes.disturbance is not None
    noise = job.episodes.disturbance.torque_noise
    assert noise is not None
    np.testing.assert_allclose(noise.root @ noise.root, learner_error(run, i - 1), atol=1e-9)
    assert noise.hold == 50
    assert len(noise) == 6


@pytest.mark.parametrize("scale", [0.0, 4.0])
def test_the_covariance_is_scaled(runs, tmp_path, scale):
    run = runs("dart")
    scaled = replace(METHODS["dart"], noise_scale=scale, noise_hold=0.02)
    other = create(tmp_path / "run", replace(CONFIG, method=scaled))
    other.folder = run.folder
    other.dataset = run.dataset
    job = collection(other, 1)
    assert job.episodes.disturbance is not None
    noise = job.episodes.disturbance.torque_noise
    assert noise is not None and noise.hold == 20
    np.testing.assert_allclose(noise.root @ noise.root, scale * learner_error(run, 0), atol=1e-9)


def test_the_expert_drives_alone_under_the_noise_and_its_labels_are_clean(runs):
    """The motion is that of the commanded torques plus the noise; the labels are the LQR's."""
    run = runs("dart")
    job = collection(run, 1)
    rollouts, _ = play_out(job)
    assert rollouts.expert_drove[rollouts.happened].all()
    clean = answers(rollouts, rollouts.expert_drove)
    np.testing.assert_allclose(rollouts.torque, clean, rtol=0, atol=1e-9)
    noise = rollouts.disturbance.torque_noise
    assert noise is not None
    frames = run.dataset.load()
    for b, episode in enumerate(job.episode.tolist()):
        n = int(rollouts.length[b]) - 1
        held = np.array([noise.draw(b, t // 50) for t in range(n)])
        acting = np.clip(rollouts.torque[b, :n] + held, -LIMIT, LIMIT)
        moved = np.diff(rollouts.v[b, : n + 1, 6:], axis=0)
        np.testing.assert_allclose(moved, toy.DT * acting / toy.INERTIA, atol=1e-9)
        own = frames[frames.episode == episode]
        np.testing.assert_array_equal(own.torque, rollouts.torque[b, : len(own)])
    assert np.abs(held).max() > 1e-3


def test_the_noise_of_an_episode_does_not_depend_on_its_chunk_or_process(runs):
    run = runs("dart")
    job = collection(run, 2)
    whole = run_chunk(job)
    for chunk in chunks_of(replace(job, config=replace(job.config, chunk=4))):
        sent = pickle.loads(pickle.dumps(replace(chunk, plan=None)))
        part = run_chunk(replace(sent, plan=job.plan))
        for episode in part.summary.episode.tolist():
            expected = whole.frames[whole.frames.episode == episode]
            assert part.frames[part.frames.episode == episode].hash == expected.hash


def test_labels_cost_what_the_expert_drives(runs):
    for i in (1, 2):
        record = collected(runs("dart"), i)
        assert record.expert_share == 1.0
        assert record.takeovers == 0
        assert record.plans == pytest.approx(solves_of(record.expert_seconds), abs=6)


def test_frames_have_to_be_held_out(tmp_path):
    training = replace(CONFIG.training, validation=0.0)
    config = replace(CONFIG, method=METHODS["dart"], training=training)
    with pytest.raises(ValueError, match="validation is 0, but the noise is fitted to frames held"):
        check_config(config)


def test_a_dataset_without_held_out_frames_is_an_error(runs, tmp_path):
    run = runs("dart")
    config = replace(CONFIG, method=METHODS["dart"])
    other = create(tmp_path / "run", config)
    other.folder = run.folder
    with pytest.raises(RunError, match="no frame held out to fit the noise to"):
        learner_error(other, 0)


def test_the_pretraining_is_without_noise(runs):
    job = collection(runs("dart"), 0)
    assert job.episodes.disturbance is None
    same = collected(runs("dagger"), 0)
    assert replace(collected(runs("dart"), 0), seconds=same.seconds) == same


@pytest.mark.thorough  # of all methods, this is the one that is killed in `test_all_methods.py`
def test_a_run_of_dart_again_has_the_same_noise(runs, tmp_path):
    again = run_method(tmp_path, replace(CONFIG, method=METHODS["dart"]))
    assert again.dataset.hash == runs("dart").dataset.hash
