"""Training: it learns, repeats to the bit, splits by episode, and refuses bad frames."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from surefoot.config import PolicyConfig, TrainingConfig
from surefoot.dataset import Frames, concatenate
from surefoot.observation import network_input
from surefoot.policy import Policy, PolicyNetwork, pd
from surefoot.train import examples, fit, held_out

SMALL = PolicyConfig(hidden=(64, 64))
TRAINING = TrainingConfig(batch=64)


def toy_frames(episodes, each=100):
    """A linear controller drives: joint targets are a linear map of the observation and goal."""
    gain = np.random.default_rng(0).normal(size=(47, 12)) * 0.05
    parts = []
    for episode in episodes:
        rng = np.random.default_rng((1, episode))
        q = np.zeros((each, 19))
        q[:, 2] = 0.25 + 0.02 * rng.normal(size=each)
        q[:, 3:7] = np.array([0, 0, 0, 1]) + 0.1 * rng.normal(size=(each, 4))
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        q[:, 7:] = 0.3 * rng.normal(size=(each, 12))
        v = rng.normal(size=(each, 18))
        frames = Frames(
            q=q,
            v=v,
            com=q[:, :3].copy(),
            feet=0.1 * rng.normal(size=(each, 4, 3)),
            contacts=np.ones((each, 4), bool),
            tick=np.arange(each),
            command=np.tile([0.1 * (episode % 4), 0.0, 0.0], (each, 1)),
            torque=np.zeros((each, 12)),
            expert_drove=np.ones(each, bool),
            episode=np.full(each, episode),
            outcome=np.zeros(each, np.int8),
        )
        target = network_input(frames.state, frames.tick, frames.command, 500) @ gain
        parts.append(replace(frames, torque=pd(target, q, v, SMALL)))
    return concatenate(parts)


FRAMES = toy_frames(range(20))


def run(frames=FRAMES, epochs=2, seed=0, config=TRAINING, network=None, **kwargs):
    network = network or PolicyNetwork(SMALL, seed=0)
    return fit(network, frames, config, SMALL, epochs, seed, 500, **kwargs)


def weights(network):
    return torch.cat([tensor.double().flatten() for tensor in network.state_dict().values()])


def test_examples_are_inputs_and_labels():
    inputs, labels = examples(FRAMES, SMALL, 500)
    expected = network_input(FRAMES.state, FRAMES.tick, FRAMES.command, 500)
    np.testing.assert_array_equal(inputs.numpy(), expected)
    q, v = FRAMES.q, FRAMES.v
    np.testing.assert_allclose(pd(labels.numpy(), q, v, SMALL), FRAMES.torque, atol=1e-5)


def test_examples_do_not_depend_on_the_chunk(monkeypatch):
    whole = examples(FRAMES, SMALL, 500)
    monkeypatch.setattr("surefoot.train._ROWS", 37)
    for part, expected in zip(examples(FRAMES, SMALL, 500), whole, strict=True):
        assert torch.equal(part, expected)


def test_learns_a_linear_controller():
    frames = toy_frames(range(100))
    result = run(frames, 25, config=TrainingConfig(batch=64, schedule="cosine"))
    labels = examples(frames, SMALL, 500)[1]
    untrained = (labels - labels.median(0).values).abs().mean().item()
    assert untrained > 0.1
    assert result.validation_loss[-1] < 0.15 * untrained
    assert result.train_loss[-1] < result.train_loss[0] / 4
    # And the policy made of it gives the controller's torque.
    policy = Policy(result.network, SMALL, 500, frames.command_range)
    torque = policy.torque(frames.state, frames.tick, frames.command, np.ones(len(frames), bool))
    assert np.abs(torque - frames.torque).mean() < 0.15 * SMALL.kp * untrained


def test_reported_losses_are_those_of_the_network():
    result = run()
    out = held_out(FRAMES.episode, 0.1)
    inputs, labels = examples(FRAMES[out], SMALL, 500)
    assert not result.network.training
    with torch.no_grad():
        loss = torch.nn.functional.l1_loss(result.network(inputs), labels).item()
    assert result.validation_loss[-1] == pytest.approx(loss, rel=1e-5)


@pytest.mark.parametrize("schedule", ["constant", "cosine"])
def test_same_inputs_same_bits(schedule):
    config = replace(TRAINING, schedule=schedule)
    one, other = run(config=config), run(config=config)
    assert torch.equal(weights(one.network), weights(other.network))
    assert one.train_loss == other.train_loss and one.validation_loss == other.validation_loss
    assert not torch.equal(weights(one.network), weights(run(seed=1, config=config).network))


def test_learning_rates(monkeypatch):
    rates = []
    step = torch.optim.Adam.step

    def recorded(self, *args):
        rates.append(float(self.param_groups[0]["lr"]))
        return step(self, *args)

    monkeypatch.setattr(torch.optim.Adam, "step", recorded)
    steps = run(epochs=3).steps
    assert rates == [2e-3] * steps
    rates.clear()
    run(epochs=3, config=replace(TRAINING, schedule="cosine"))
    expected = 1e-3 * (1 + np.cos(np.pi * np.arange(steps) / steps))
    np.testing.assert_allclose(rates, expected, atol=1e-9)


def test_steps_and_the_incomplete_batch():
    training = int((~held_out(FRAMES.episode, 0.1)).sum())
    assert training % 64 != 0
    assert run(epochs=3).steps == 3 * (training // 64)


def test_caller_and_threads_are_left_alone():
    network = PolicyNetwork(SMALL)
    before, threads = weights(network), torch.get_num_threads()
    generator = torch.get_rng_state()
    config = replace(TRAINING, threads=2)
    result = run(network=network, config=config, epochs=1)
    assert torch.equal(weights(network), before)
    assert result.network is not network
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), generator)


def test_second_fit_keeps_normalisers_and_carries_weights_over():
    first = run(epochs=6)
    assert first.network.has_normalisers
    shifted = replace(FRAMES, v=FRAMES.v * 3.0)
    second = run(shifted, network=first.network)
    assert torch.equal(second.network.mean, first.network.mean)
    assert torch.equal(second.network.scale, first.network.scale)
    again = run(epochs=1, network=first.network)
    assert again.train_loss[0] < first.train_loss[0] / 2


def test_normalisers_come_from_the_training_episodes():
    result = run(epochs=1)
    inputs, _ = examples(FRAMES[~held_out(FRAMES.episode, 0.1)], SMALL, 500)
    torch.testing.assert_close(result.network.mean, inputs.mean(0), atol=1e-5, rtol=1e-5)
    vy = 42 + 3
    assert result.network.scale[vy] == 1


def test_split_is_by_episode_and_by_the_id_alone():
    ids = np.arange(20_000)
    out = held_out(ids, 0.1)
    assert out.mean() == pytest.approx(0.1, abs=0.01)
    assert out[:1000].mean() == pytest.approx(0.1, abs=0.04)
    np.testing.assert_array_equal(held_out(ids[::-7], 0.1), out[::-7])
    frames_out = held_out(FRAMES.episode, 0.1)
    assert (frames_out.reshape(20, 100).all(1) | ~frames_out.reshape(20, 100).any(1)).all()
    assert 0 < frames_out.sum() < len(FRAMES)
    assert not held_out(ids, 0.0).any()


def test_held_out_frames_do_not_reach_the_weights():
    out = held_out(FRAMES.episode, 0.1)
    torque = np.where(out[:, None], 100.0, FRAMES.torque)
    one, other = run(), run(replace(FRAMES, torque=torque))
    assert torch.equal(weights(one.network), weights(other.network))
    assert one.validation_loss != other.validation_loss


def test_without_held_out_episodes():
    result = run(config=replace(TRAINING, validation=0.0), epochs=1)
    assert np.isnan(result.validation_loss[0]) and np.isfinite(result.train_loss[0])


def test_progress():
    calls = []
    result = run(progress=lambda *args: calls.append(args))
    losses = zip(result.train_loss, result.validation_loss, strict=True)
    assert calls == [(epoch, 2, *pair) for epoch, pair in enumerate(losses, 1)]


@pytest.mark.parametrize("field", ["q", "feet", "torque", "command"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite(field, value):
    array = getattr(FRAMES, field).copy()
    array[123].flat[-1] = value
    message = r"frame 123 \(episode 1, tick 23\) holds numbers that are not finite"
    with pytest.raises(ValueError, match=message):
        run(replace(FRAMES, **{field: array}))


def test_too_few_frames():
    with pytest.raises(ValueError, match=r"50 frames.*less than one batch of 64: collect more"):
        run(FRAMES[:50])
    with pytest.raises(ValueError, match="less than one batch"):
        run(FRAMES[:0])


def test_options_are_checked():
    with pytest.raises(ValueError, match=r"'linear' is unknown; use one of .*constant.*cosine"):
        run(config=replace(TRAINING, schedule="linear"))
    with pytest.raises(ValueError, match="0 epochs"):
        run(epochs=0)


def test_a_loss_that_explodes_is_reported():
    with pytest.raises(FloatingPointError, match="learning rate below"):
        run(config=replace(TRAINING, learning_rate=1e38))
