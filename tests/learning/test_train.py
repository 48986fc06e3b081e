"""Training: it learns, repeats to the bit, splits by episode, and refuses bad frames."""

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import surefoot.learning.train as train_module
from surefoot.config import NumberFormat, Steps, TrainingConfig
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames, concatenate
from surefoot.learning.layouts import LAYOUTS
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE, OBSERVATION_SIZE
from surefoot.learning.policy import Policy
from surefoot.learning.precision import PrecisionChoice
from surefoot.learning.samples import WIDTH, derive, held_out
from surefoot.learning.symmetry import Mirror, Mirrored
from surefoot.learning.train import fit, split_samples
from tests.fakes.killed import Killed
from tests.fakes.learning import SMALL, SPEC, spec_of, toy_frames

TRAINING = TrainingConfig(batch=64, precision="float32")
FRAMES = toy_frames(range(20))
LEFT_RIGHT = Mirror(
    (1, -1, 1), (1, 0, 3, 2), (3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8), (-1, 1, 1) * 4, 250
)
MIRRORED = replace(TRAINING, mirror="left_right")


def run(
    frames: Frames | Dataset | Mirrored = FRAMES,
    epochs: int | Steps = 2,
    seed=0,
    config=TRAINING,
    network=None,
    **kwargs,
):
    network = network or PolicyNetwork(SMALL, seed=0)
    return fit(network, frames, config, SPEC, epochs, seed, **kwargs)


def weights(network):
    return torch.cat([tensor.double().flatten() for tensor in network.state_dict().values()])


def inputs_and_targets(frames):
    """Both as tensors."""
    rows = torch.from_numpy(derive(frames, SPEC))
    return rows[:, :INPUT_SIZE], rows[:, INPUT_SIZE:]


def test_a_fit_learns_a_linear_controller():
    frames = toy_frames(range(60))
    fast = replace(TRAINING, schedule="cosine", learning_rate=8e-3)
    result = run(frames, 12, config=fast)
    targets = inputs_and_targets(frames)[1]
    untrained = (targets - targets.median(0).values).abs().mean().item()
    assert untrained > 0.1
    assert result.validation_loss[-1] < 0.15 * untrained
    assert result.train_loss[-1] < result.train_loss[0] / 4
    # And the policy made of it gives the controller's torque.
    policy = Policy(result.network, SPEC, frames.command_range, "solo12")
    torque = policy.torque(frames.state, frames.tick, frames.command, np.ones(len(frames), bool))
    assert np.abs(torque - frames.torque).mean() < 0.15 * SPEC.kp * untrained


def test_reported_losses_are_those_of_the_network():
    result = run()
    out = held_out(FRAMES.episode, 0.1)
    inputs, targets = inputs_and_targets(FRAMES[out])
    assert not result.network.training
    with torch.no_grad():
        loss = torch.nn.functional.l1_loss(result.network(inputs), targets).item()
    assert result.validation_loss[-1] == pytest.approx(loss, rel=1e-5)


@pytest.mark.parametrize("schedule", ["constant", "cosine"])
def test_the_same_inputs_give_the_same_bits(schedule):
    config = replace(TRAINING, schedule=schedule)
    one = run(config=config)
    other = run(config=config)
    assert torch.equal(weights(one.network), weights(other.network))
    assert one.train_loss == other.train_loss
    assert one.validation_loss == other.validation_loss
    assert not torch.equal(weights(one.network), weights(run(seed=1, config=config).network))


def test_the_learning_rate_follows_the_schedule(monkeypatch):
    rates = []
    step = torch.optim.Adam.step

    def recorded(self, *args):
        rates.append(float(self.param_groups[0]["lr"]))
        return step(self, *args)

    monkeypatch.setattr(torch.optim.Adam, "step", recorded)
    steps = run(epochs=3).steps
    np.testing.assert_allclose(rates, [2e-3] * steps, rtol=1e-7)
    rates.clear()
    run(epochs=3, config=replace(TRAINING, schedule="cosine"))
    expected = 1e-3 * (1 + np.cos(np.pi * np.arange(steps) / steps))
    np.testing.assert_allclose(rates, expected, atol=1e-9)


def test_noise_moves_observations_only_and_by_the_share_asked_for(monkeypatch):
    seen = []
    step = train_module.TrainingStep.__call__

    def recorded(self, rows):
        seen.append(rows.clone())
        step(self, rows)

    monkeypatch.setattr(train_module.TrainingStep, "__call__", recorded)
    network = run(epochs=1).network
    clean = torch.cat(seen)
    seen.clear()
    run(epochs=1, config=replace(TRAINING, input_noise=0.2))
    noise = torch.cat(seen) - clean
    assert torch.equal(noise[:, OBSERVATION_SIZE:], torch.zeros_like(noise[:, OBSERVATION_SIZE:]))
    share = noise[:, :OBSERVATION_SIZE].std(0) / network.scale[:OBSERVATION_SIZE]
    torch.testing.assert_close(share, torch.full_like(share, 0.2), rtol=0.1, atol=0.0)


def test_numbers_that_are_constant_in_the_data_get_no_noise():
    network = PolicyNetwork(SMALL, 0)
    deviation = torch.linspace(0.5, 2.0, len(network.scale), dtype=torch.float64)
    deviation[:4] = 0.0
    network.set_normalizers(torch.zeros_like(deviation), deviation)
    assert torch.equal(network.deviation, deviation.float())


def test_a_fit_with_noise_and_decay_killed_in_any_epoch_ends_with_the_same_bits(tmp_path):
    config = replace(TRAINING, input_noise=0.1, weight_decay=0.5, schedule="cosine")

    def die(*_):
        raise Killed

    for _ in range(2):
        with pytest.raises(Killed):
            run(epochs=3, config=config, checkpoint=tmp_path / "checkpoint", progress=die)
    resumed = run(epochs=3, config=config, checkpoint=tmp_path / "checkpoint")
    whole = run(epochs=3, config=config)
    assert torch.equal(weights(resumed.network), weights(whole.network))
    assert resumed.train_loss == whole.train_loss
    assert not torch.equal(weights(whole.network), weights(run(epochs=3).network))


def test_the_incomplete_batch_of_an_epoch_is_dropped():
    training = int((~held_out(FRAMES.episode, 0.1)).sum())
    assert training % 64 != 0
    assert run(epochs=3).steps == 3 * (training // 64)


def test_steps_that_fill_whole_epochs_give_the_bits_of_epochs():
    config = replace(TRAINING, schedule="cosine")
    whole = run(epochs=3, config=config)
    stepped = run(epochs=Steps(whole.steps), config=config)
    assert torch.equal(weights(whole.network), weights(stepped.network))
    assert stepped.train_loss == whole.train_loss


def test_a_number_of_steps_may_end_within_an_epoch(monkeypatch):
    batches = run(epochs=1).steps
    rates = []
    step = torch.optim.Adam.step

    def recorded(self, *args):
        rates.append(float(self.param_groups[0]["lr"]))
        return step(self, *args)

    monkeypatch.setattr(torch.optim.Adam, "step", recorded)
    steps = 2 * batches + 5
    seen = []
    config = replace(TRAINING, schedule="cosine")
    result = run(epochs=Steps(steps), config=config, progress=lambda *each: seen.append(each[:2]))
    expected = 1e-3 * (1 + np.cos(np.pi * np.arange(steps) / steps))
    np.testing.assert_allclose(rates, expected, atol=1e-9)
    assert result.steps == steps
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert len(result.train_loss) == 3
    few = run(epochs=Steps(3))
    assert (few.steps, len(few.train_loss)) == (3, 1)
    assert few.train_loss[0] > result.train_loss[0]  # a mean over the steps that were taken


def test_a_fit_of_steps_killed_in_any_epoch_ends_with_the_same_bits(tmp_path):
    steps = Steps(2 * run(epochs=1).steps + 5)
    checkpoint = tmp_path / "checkpoint"

    def die(*_):
        raise Killed

    for _ in range(2):
        with pytest.raises(Killed):
            run(epochs=steps, checkpoint=checkpoint, progress=die)
    resumed = run(epochs=steps, checkpoint=checkpoint)
    assert torch.equal(weights(resumed.network), weights(run(epochs=steps).network))


def test_no_steps_are_refused():
    with pytest.raises(ValueError, match="0 steps: at least 1 is needed"):
        run(epochs=Steps(0))


def test_network_threads_and_generator_of_the_caller_are_left_alone():
    network = PolicyNetwork(SMALL)
    before = weights(network)
    threads = torch.get_num_threads()
    generator = torch.get_rng_state()
    config = replace(TRAINING, threads=2)
    result = run(network=network, config=config, epochs=1)
    assert torch.equal(weights(network), before)
    assert result.network is not network
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), generator)


def test_a_second_fit_keeps_normalizers_and_carries_weights_over():
    first = run(epochs=6)
    assert first.network.has_normalisers
    shifted = replace(FRAMES, v=FRAMES.v * 3.0)
    second = run(shifted, network=first.network)
    assert torch.equal(second.network.mean, first.network.mean)
    assert torch.equal(second.network.scale, first.network.scale)
    again = run(epochs=1, network=first.network)
    assert again.train_loss[0] < first.train_loss[0] / 2


def test_normalizers_come_from_the_training_episodes():
    result = run(epochs=1)
    inputs, _ = inputs_and_targets(FRAMES[~held_out(FRAMES.episode, 0.1)])
    torch.testing.assert_close(result.network.mean, inputs.mean(0), atol=1e-5, rtol=1e-5)
    vy = 42 + 3
    assert result.network.scale[vy] == 1


def test_held_out_frames_do_not_reach_the_weights():
    out = held_out(FRAMES.episode, 0.1)
    torque = np.where(out[:, None], 100.0, FRAMES.torque)
    one = run()
    other = run(replace(FRAMES, torque=torque))
    assert torch.equal(weights(one.network), weights(other.network))
    assert one.validation_loss != other.validation_loss


def test_samples_are_split_by_episode():
    samples = split_samples(FRAMES, TRAINING, SPEC)
    out = held_out(FRAMES.episode, 0.1)
    rows = derive(FRAMES, SPEC)
    np.testing.assert_array_equal(next(samples.training.buffers()), rows[~out])
    np.testing.assert_array_equal(next(samples.validation.buffers()), rows[out])
    np.testing.assert_array_equal(samples.command_range, FRAMES.command_range)
    assert len(samples) == len(FRAMES)


@pytest.mark.parametrize("writable", [True, False])
def test_samples_of_a_shared_dataset_are_kept_elsewhere(tmp_path, monkeypatch, writable):
    data = stored(tmp_path)
    folders = []
    samples = train_module.TrainingSamples

    def kept(limit, folder, width):
        folders.append(folder)
        return samples(limit, folder, width)

    monkeypatch.setattr(train_module, "TrainingSamples", kept)
    monkeypatch.setattr(train_module.os, "access", lambda *_: writable)
    split_samples(data, TRAINING, SPEC)
    assert folders == [data.folder if writable else None] * 2


def test_the_validation_loss_without_held_out_episodes_is_nan():
    result = run(config=replace(TRAINING, validation=0.0), epochs=1)
    assert np.isnan(result.validation_loss[0])
    assert np.isfinite(result.train_loss[0])


def test_progress_is_called_after_each_epoch():
    calls = []
    result = run(progress=lambda *args: calls.append(args))
    losses = zip(result.train_loss, result.validation_loss, strict=True)
    assert calls == [(epoch, 2, *pair) for epoch, pair in enumerate(losses, 1)]


def test_too_few_frames_are_an_error():
    with pytest.raises(ValueError, match=r"training\.batch is 64, but there are only 50 frames"):
        run(FRAMES[:50])
    with pytest.raises(ValueError, match=r"training\.batch is 64, .* only 0 frames"):
        run(FRAMES[:0])


def test_a_batch_that_does_not_fit_in_memory_is_an_error():
    with pytest.raises(ValueError, match=r"batch of 20000 .* does not fit in training.memory"):
        run(toy_frames(range(250)), config=replace(TRAINING, batch=20_000, memory=1))


def test_no_epochs_are_an_error():
    with pytest.raises(ValueError, match="0 epochs"):
        run(epochs=0)


def test_a_negative_seed_is_an_error():
    with pytest.raises(ValueError, match="the seed is -1; use 0 or more"):
        run(seed=-1)


def test_a_loss_that_explodes_is_an_error():
    with pytest.raises(FloatingPointError, match="learning rate below"):
        run(replace(FRAMES, torque=np.full_like(FRAMES.torque, 1e38)))


# --- mirror images


def test_training_on_images_is_training_on_both_recordings():
    aside = replace(FRAMES, command=FRAMES.command + np.array([0.0, 0.1, -0.2]))
    both = concatenate([aside, LEFT_RIGHT.frames(aside)])
    mirrored = run(Mirrored(aside, LEFT_RIGHT), config=MIRRORED)
    recorded = run(both, Steps(mirrored.steps))
    assert torch.equal(weights(mirrored.network), weights(recorded.network))
    assert mirrored.validation_loss == recorded.validation_loss
    np.testing.assert_array_equal(mirrored.command_range, both.command_range)
    assert mirrored.frames == len(FRAMES)
    assert not torch.equal(weights(mirrored.network), weights(run(aside).network))


@pytest.mark.parametrize("epochs", [1, 2, 5])
def test_a_pass_has_as_many_steps_with_images_as_without(epochs):
    mirrored = run(Mirrored(FRAMES, LEFT_RIGHT), epochs, config=MIRRORED)
    plain = run(epochs=epochs)
    assert mirrored.steps == plain.steps


def test_the_mirror_auto_takes_data_with_images_or_without():
    auto = replace(TRAINING, mirror="auto")
    data = Mirrored(FRAMES, LEFT_RIGHT)
    assert torch.equal(
        weights(run(data, config=auto).network), weights(run(data, config=MIRRORED).network)
    )
    assert torch.equal(weights(run(config=auto).network), weights(run().network))


def test_an_image_is_held_out_with_its_frame():
    samples = split_samples(Mirrored(FRAMES, LEFT_RIGHT), MIRRORED, SPEC)
    out = held_out(FRAMES.episode, 0.1)
    images = derive(LEFT_RIGHT.frames(FRAMES), SPEC)
    rows = derive(FRAMES, SPEC)
    for part, chosen in ((samples.training, ~out), (samples.validation, out)):
        expected = np.concatenate([rows[chosen], images[chosen]])
        np.testing.assert_array_equal(next(part.buffers()), expected)
    assert samples.frames == len(FRAMES)


def test_a_mirrored_fit_has_the_same_bits_again_and_when_killed(tmp_path):
    data = Mirrored(stored(tmp_path), LEFT_RIGHT)
    whole = run(data, epochs=6, config=MIRRORED)
    assert torch.equal(weights(whole.network), weights(run(data, 6, config=MIRRORED).network))
    checkpoint = tmp_path / "checkpoint"

    def die(*_):
        raise Killed

    for _ in range(2):
        with pytest.raises(Killed):
            run(data, epochs=6, config=MIRRORED, checkpoint=checkpoint, progress=die)
    seen = []
    resumed = run(
        data,
        epochs=6,
        config=MIRRORED,
        checkpoint=checkpoint,
        progress=lambda epoch, *_: seen.append(epoch),
    )
    assert torch.equal(weights(resumed.network), weights(whole.network))
    assert resumed.train_loss == whole.train_loss
    assert seen == [3]


def test_a_checkpoint_of_another_mirror_is_not_resumed(tmp_path):
    checkpoint = tmp_path / "checkpoint"
    other = replace(LEFT_RIGHT, shift=0)
    run(Mirrored(FRAMES, other), config=MIRRORED, checkpoint=checkpoint)
    resumed = run(Mirrored(FRAMES, LEFT_RIGHT), config=MIRRORED, checkpoint=checkpoint)
    fresh = run(Mirrored(FRAMES, LEFT_RIGHT), config=MIRRORED)
    assert torch.equal(weights(resumed.network), weights(fresh.network))


def test_a_mirror_that_is_asked_for_and_not_given_is_refused():
    with pytest.raises(
        ValueError, match=r"training\.mirror is left_right, but the data are Frames"
    ):
        run(config=MIRRORED)
    with pytest.raises(ValueError, match=r"training\.mirror is none, but the data are Mirrored"):
        run(Mirrored(FRAMES, LEFT_RIGHT))


# --- more data than memory, kills, precision, devices


def stored(tmp_path, frames=FRAMES, shards=4) -> Dataset:
    dataset = Dataset(tmp_path / "data")
    for number, ids in enumerate(np.array_split(np.unique(frames.episode), shards)):
        dataset.append(f"part-{number}", frames[np.isin(frames.episode, ids)])
    return dataset


def test_data_on_disk_train_as_in_memory(tmp_path):
    one = run()
    other = run(stored(tmp_path))
    assert torch.equal(weights(one.network), weights(other.network))
    assert other.frames == len(FRAMES)
    np.testing.assert_array_equal(other.command_range, FRAMES.command_range)


@pytest.mark.thorough
def test_ten_times_more_data_than_memory_learns_as_well(tmp_path, monkeypatch):
    frames = toy_frames(range(100))
    config = TrainingConfig(batch=64, precision="float32", schedule="cosine")
    whole = run(frames, 12, config=config)
    sizes = []
    original = train_module.TrainingSamples

    def small(limit, folder, width):
        sizes.append(limit)
        return original(len(frames) * WIDTH * 4 // 10, folder, width)

    monkeypatch.setattr(train_module, "TrainingSamples", small)
    blocks = run(stored(tmp_path, frames), 12, config=config)
    assert sorted(sizes) == [102_400_000, 921_600_000]
    assert blocks.steps == pytest.approx(whole.steps, rel=0.1)
    assert blocks.validation_loss[-1] < 1.2 * whole.validation_loss[-1]
    again = run(stored(tmp_path / "again", frames), 12, config=config)
    assert torch.equal(weights(blocks.network), weights(again.network))


@pytest.mark.thorough
def test_peak_memory_is_bounded_however_large_the_dataset(tmp_path):
    """Samples of five times the bound cost no more memory than those of the bound."""
    program = """
import resource, sys
import surefoot as sf
from surefoot.config import PolicyConfig, TrainingConfig
from surefoot.learning.policy import policy_spec
policy = PolicyConfig(hidden=(16,))
spec = policy_spec(sf.Config(policy=policy))
config = TrainingConfig(batch=4096, memory=8, precision="float32")
result = sf.fit(sf.PolicyNetwork(policy), sf.Dataset(sys.argv[1]), config, spec, 1, 0)
print(result.frames, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000)
"""
    bound = 8_000_000 // (WIDTH * 4)
    piece = toy_frames(range(20), each=bound // 100)
    peaks = []
    for times in (1, 5):
        dataset = Dataset(tmp_path / str(times))
        for number in range(5 * times):
            dataset.append(f"part-{number}", replace(piece, episode=piece.episode + 20 * number))
        command = [sys.executable, "-c", program, str(dataset.folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        frames, peak = done.stdout.split()
        assert int(frames) == dataset.frames == pytest.approx(times * bound, rel=0.01)
        peaks.append(float(peak))
    # [MB] The samples beyond the bound would take 32, their frames 76.
    assert peaks[1] - peaks[0] < 20


@pytest.mark.parametrize("schedule", ["constant", "cosine"])
@pytest.mark.parametrize("epoch", [1, 3])
def test_a_fit_killed_after_an_epoch_resumes_to_the_same_bits(tmp_path, schedule, epoch):
    config = replace(TRAINING, schedule=schedule)
    path = tmp_path / "fit.safetensors"
    whole = run(epochs=4, config=config)

    def die(done, *_):
        if done == epoch:
            raise Killed

    with pytest.raises(Killed):
        run(epochs=4, config=config, progress=die, checkpoint=path)
    epochs = []
    resumed = run(
        epochs=4, config=config, checkpoint=path, progress=lambda done, *_: epochs.append(done)
    )
    assert epochs == list(range(epoch + 1, 5))
    assert torch.equal(weights(resumed.network), weights(whole.network))
    assert resumed.train_loss == whole.train_loss
    assert resumed.validation_loss == whole.validation_loss


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_killed_fit_of_any_layout_resumes_where_it_was(tmp_path, layout):
    spec = spec_of(replace(SMALL, layout=layout))
    inputs = spec.observation.input_size
    elapsed = np.tile(np.arange(100, dtype=np.int32), 20)
    frames = replace(FRAMES, elapsed=elapsed)

    def fitted(**kwargs):
        network = PolicyNetwork(SMALL, 0, inputs)
        return fit(network, frames, TRAINING, spec, 2, 0, **kwargs)

    def die(*_):
        raise Killed

    with pytest.raises(Killed):
        fitted(progress=die, checkpoint=tmp_path / "fit.safetensors")
    epochs = []
    resumed = fitted(
        checkpoint=tmp_path / "fit.safetensors", progress=lambda done, *_: epochs.append(done)
    )
    assert epochs == [2]
    assert torch.equal(weights(resumed.network), weights(fitted().network))


def test_a_fit_goes_on_in_the_format_that_it_began_with(tmp_path, monkeypatch):
    """Where both formats are about equally fast, the next timing may name the other one."""
    config = replace(TRAINING, precision="auto")
    path = tmp_path / "fit.safetensors"
    formats: list[NumberFormat] = ["bfloat16", "float32"]
    choices = iter(formats)

    def chosen(*_):
        return PrecisionChoice(next(choices))

    def die(*_):
        raise Killed

    epochs = []
    with monkeypatch.context() as patch:
        patch.setattr(train_module, "choose_precision", chosen)
        with pytest.raises(Killed):
            run(epochs=2, config=config, progress=die, checkpoint=path)
        resumed = run(
            epochs=2, config=config, checkpoint=path, progress=lambda done, *_: epochs.append(done)
        )
    assert epochs == [2]
    whole = run(epochs=2, config=replace(TRAINING, precision="bfloat16"))
    assert torch.equal(weights(resumed.network), weights(whole.network))


def test_a_checkpoint_of_another_fit_or_cut_short_is_not_taken(tmp_path):
    path = tmp_path / "fit.safetensors"
    run(replace(FRAMES, torque=2.0 * FRAMES.torque), epochs=2, checkpoint=path)
    fresh = run(epochs=2, checkpoint=path)
    assert torch.equal(weights(fresh.network), weights(run(epochs=2).network))
    other = run(epochs=2, seed=1, checkpoint=path)
    assert torch.equal(weights(other.network), weights(run(epochs=2, seed=1).network))
    path.write_bytes(path.read_bytes()[:-9])
    again = run(epochs=2, seed=1, checkpoint=path)
    assert torch.equal(weights(other.network), weights(again.network))


@pytest.mark.parametrize(("layout", "resumes"), [("proprioceptive", False), ("full", True)])
def test_a_changed_past_is_another_fit_where_the_network_remembers(tmp_path, layout, resumes):
    spec = spec_of(replace(SMALL, layout=layout))
    path = tmp_path / "fit.safetensors"
    frames = replace(FRAMES, elapsed=np.tile(np.arange(100, dtype=np.int32), 20))
    changed = replace(frames, applied=frames.applied + 1.0)
    assert changed.hash == frames.hash
    epochs = []
    for one in (frames, changed):
        dataset = Dataset(tmp_path / str(len(epochs)))
        dataset.append("all", one)
        network = PolicyNetwork(SMALL, 0, spec.observation.input_size)

        def progress(done, *_):
            epochs.append(done)

        fit(network, dataset, TRAINING, spec, 1, 0, progress, path)
    assert epochs == ([1] if resumes else [1, 1])


def test_a_changed_bit_of_a_checkpoint_changes_no_weights(tmp_path):
    path = tmp_path / "fit.safetensors"
    whole = run(epochs=3)

    def flip_and_die(done, *_):
        if done == 1:
            content = bytearray(path.read_bytes())
            content[-5000] ^= 1
            path.write_bytes(bytes(content))
            raise Killed

    with pytest.raises(Killed):
        run(epochs=3, checkpoint=path, progress=flip_and_die)
    again = run(epochs=3, checkpoint=path)
    assert torch.equal(weights(again.network), weights(whole.network))


def test_a_checkpoint_holds_losses_that_are_not_numbers(tmp_path):
    config = replace(TRAINING, validation=0.0)
    path = tmp_path / "fit.safetensors"
    run(epochs=2, config=config, checkpoint=path)
    again = run(epochs=2, config=config, checkpoint=path)
    assert np.isnan(again.validation_loss).all()
    assert np.isfinite(again.train_loss).all()


def test_bfloat16_products_learn_as_well():
    frames = toy_frames(range(40))
    config = TrainingConfig(batch=64, precision="float32", schedule="cosine")
    short, full = (
        run(frames, 5, config=replace(config, precision=precision))
        for precision in ("bfloat16", "float32")
    )
    assert short.validation_loss[-1] < 1.05 * full.validation_loss[-1]
    assert all(tensor.dtype != torch.bfloat16 for tensor in short.network.state_dict().values())
    same = torch.equal(weights(short.network), weights(full.network))
    assert not same


def test_learning_runs_where_there_is_no_robotics_stack():
    """In a process in which nothing of it can be imported."""
    program = """
import sys
robotics = "pinocchio mujoco pybullet numba scipy example_robot_data loky ray onnx onnxruntime tyro"
for name in robotics.split():
    sys.modules[name] = None
import surefoot as sf
from tests.fakes.learning import SMALL, SPEC, spec_of, toy_frames
frames = toy_frames(range(5))
from surefoot.config import Steps, TrainingConfig
data = sf.Dataset(sys.argv[1])
data.append("all", frames)
config = TrainingConfig(batch=64, precision="float32")
result = sf.fit(sf.PolicyNetwork(SMALL), data, config, SPEC, 1, 0)
policy = sf.Policy(result.network, SPEC, result.command_range, "solo12")
sf.save(policy, sys.argv[1] + "/policy")
assert sf.load(sys.argv[1] + "/policy").spec == SPEC
"""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", program, folder]
        done = subprocess.run(
            command, cwd=Path(__file__).parents[2], capture_output=True, text=True
        )
    assert done.returncode == 0, done.stderr
