"""The small network of the gates: it learns, knows how well, and comes back to the bit."""

import hashlib
import json
import os
import pickle
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open

from surefoot.learning.classifier import (
    FORMAT,
    Classifier,
    ClassifierQuality,
    digest,
    fit_classifier,
    judge_classifier,
    load_classifier,
    save_classifier,
)

UNJUDGED = ClassifierQuality(rows=1, share_yes=0.5, seed=0)


def toy(n=4000, seed=0, share=0.5):
    """Positive inside a shell, which no linear rule can tell; one input is constant."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 6)).astype(np.float32) * [1, 10, 0.1, 1, 1, 1] + [0, 5, 0, 0, 0, 0]
    radius = (x[:, 0] ** 2) + ((x[:, 1] - 5) / 10) ** 2
    positive = radius < np.quantile(radius, share)
    x[:, 5] = 3.0
    held_out = np.arange(n) % 5 == 0
    return x.astype(np.float32), positive, held_out


def probabilities(layers, rows):
    """The network in float64, by hand."""
    x = rows.astype(np.float64)
    for number, (weight, bias) in enumerate(layers):
        x = x @ weight.astype(np.float64) + bias
        if number < len(layers) - 1:
            x = np.maximum(x, 0.0)
    return 1.0 / (1.0 + np.exp(-x[:, 0]))


def test_a_classifier_learns_a_rule_that_is_not_linear():
    rows, positive, held_out = toy(20_000)
    classifier = fit_classifier(rows, positive, held_out, seed=0)
    quality: Any = classifier.quality
    assert quality.recall > 0.9
    assert quality.precision > 0.9
    assert quality.average_precision > 0.95
    assert quality.rows == 16_000
    assert quality.share_yes == pytest.approx(positive[~held_out].mean())


def test_the_quality_is_that_on_the_rows_held_out():
    rows, positive, held_out = toy(share=0.2)
    noise = np.random.default_rng(1).random(len(positive)) < 0.1
    positive = positive ^ noise  # which cannot be learned
    for alarm in (0.2, 0.5):
        classifier = fit_classifier(rows, positive, held_out, seed=0, alarm=alarm)
        called = classifier.probability(rows[held_out]) > alarm
        true = positive[held_out]
        quality: Any = classifier.quality
        assert quality.alarm == alarm
        assert quality.held_out == 800
        assert quality.held_out_yes == true.sum()
        assert quality.recall == pytest.approx((called & true).sum() / true.sum())
        assert quality.precision == pytest.approx((called & true).sum() / called.sum())
        assert quality.share_said == pytest.approx(called.mean())
        assert 0.3 < quality.precision < 1.0


def test_judgement_of_scores_by_hand():
    score = np.array([0.9, 0.8, 0.7, 0.6, 0.1], np.float32)
    positive = np.array([True, False, True, False, True])
    quality = judge_classifier(UNJUDGED, score, positive, 0.65)
    assert quality.recall == pytest.approx(2 / 3)
    assert quality.precision == pytest.approx(2 / 3)
    assert quality.share_said == pytest.approx(3 / 5)
    assert quality.average_precision == pytest.approx((1 + 2 / 3 + 3 / 5) / 3)
    reversed_rows = judge_classifier(UNJUDGED, score[::-1], positive[::-1], 0.65)
    assert reversed_rows == quality
    none_positive = judge_classifier(UNJUDGED, score, np.zeros(5, bool), 0.95)
    assert none_positive.recall == 0.0
    assert none_positive.precision == 0.0
    assert none_positive.average_precision == 0.0


@pytest.mark.parametrize("step", [1, -1])
def test_rows_of_one_probability_are_called_together(step):
    """A network that has learned nothing is as precise as chance, in any order of the rows."""
    positive = (np.arange(100) < 10)[::step]
    quality = judge_classifier(UNJUDGED, np.full(100, 0.3, np.float32), positive, 0.5)
    assert quality.average_precision == pytest.approx(0.1)


def test_held_out_rows_teach_nothing():
    rows, positive, held_out = toy(1000)
    layers = fit_classifier(rows, positive, held_out, seed=0).layers
    other = fit_classifier(
        np.where(held_out[:, None], np.float32(9.0), rows), positive ^ held_out, held_out, seed=0
    ).layers
    for one, two in zip(layers, other, strict=True):
        assert [a.tobytes() for a in one] == [a.tobytes() for a in two]


def test_probabilities_are_calibrated():
    """Also of what is rare: rows are not weighted."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(40_000, 3)).astype(np.float32)
    chance = 1 / (1 + np.exp(4.5 - 2.0 * rows[:, 0]))  # 5 % on the whole
    positive = rng.random(len(rows)) < chance
    held_out = np.arange(len(rows)) % 4 == 0
    probability = fit_classifier(rows, positive, held_out, seed=0).probability(rows[held_out])
    assert positive.mean() < 0.06
    assert probability.mean() == pytest.approx(positive[held_out].mean(), rel=0.15)
    high = probability > 0.25
    assert positive[held_out][high].mean() == pytest.approx(probability[high].mean(), rel=0.2)


def test_the_same_seed_gives_the_same_bits_and_leaves_torch_alone():
    rows, positive, held_out = toy(1000)
    threads = torch.get_num_threads()
    state = torch.random.get_rng_state()
    first = fit_classifier(rows, positive, held_out, seed=3)
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.random.get_rng_state(), state)
    torch.manual_seed(99)
    again, other = (fit_classifier(rows, positive, held_out, seed) for seed in (3, 4))
    assert again.quality == first.quality
    for (weight, bias), (same_weight, same_bias), (other_weight, _) in zip(
        first.layers, again.layers, other.layers, strict=True
    ):
        assert weight.tobytes() == same_weight.tobytes()
        assert bias.tobytes() == same_bias.tobytes()
        assert not np.array_equal(other_weight, weight)


def test_the_probability_is_that_of_the_network_in_float64():
    rows, positive, held_out = toy(1000)
    classifier = fit_classifier(rows, positive, held_out, seed=0)
    expected = probabilities(classifier.layers, rows)
    np.testing.assert_allclose(classifier.probability(rows), expected, atol=1e-5)
    assert classifier.probability(rows[:0]).shape == (0,)


def test_the_probability_of_a_row_does_not_depend_on_other_rows():
    rows, positive, held_out = toy(1000)
    classifier = fit_classifier(rows, positive, held_out, seed=0)
    together = classifier.probability(rows[:40])
    for part in (slice(0, 1), slice(3, 8), slice(11, 40)):
        np.testing.assert_array_equal(classifier.probability(rows[part]), together[part])
    broken = rows[:40].copy()
    broken[7] = [np.nan, np.inf, -np.inf, 3e38, 0, 0]
    others = np.arange(40) != 7
    np.testing.assert_array_equal(classifier.probability(broken)[others], together[others])


@pytest.mark.parametrize("answer", [True, False])
def test_rows_that_are_all_positive_or_none_are_learned_too(answer):
    rows, _, held_out = toy(1000)
    classifier = fit_classifier(rows, np.full(1000, answer), held_out, seed=0)
    probability = classifier.probability(rows)
    assert np.isfinite(probability).all()
    assert (probability > 0.5).all() == answer
    assert (probability < 0.5).all() != answer


def test_too_few_rows_are_an_error():
    rows, positive, _ = toy(10)
    with pytest.raises(ValueError, match="7 rows are too few"):
        fit_classifier(rows, positive, np.arange(10) < 3, seed=0)
    with pytest.raises(ValueError, match="0 rows are too few"):
        fit_classifier(rows, positive, np.ones(10, bool), seed=0)


# --- files and processes


@cache
def fitted() -> Classifier:
    """A classifier, which is fitted when a test first asks for it."""
    return fit_classifier(*toy(1000), seed=0)


ROWS = toy(50, seed=5)[0]


def test_a_classifier_comes_back_from_its_file_to_the_bit(tmp_path):
    path = tmp_path / "gates" / "history-001.safetensors"
    path.parent.mkdir()
    save_classifier(fitted(), path)
    again = load_classifier(path)
    assert again.quality == fitted().quality
    assert len(again.layers) == len(fitted().layers) == 3
    assert again.probability(ROWS).tobytes() == fitted().probability(ROWS).tobytes()
    content = path.read_bytes()
    save_classifier(again, path)
    assert path.read_bytes() == content


def test_any_changed_byte_is_refused(tmp_path):
    path = tmp_path / "history.safetensors"
    save_classifier(fitted(), path)
    content = path.read_bytes()
    rng = np.random.default_rng(0)
    unharmed = 0
    places = [*range(0, 700, 7), *rng.integers(700, len(content), 100).tolist(), len(content) - 1]
    for place in places:
        flipped = bytearray(content)
        flipped[place] ^= 1
        path.write_bytes(flipped)
        try:
            again = load_classifier(path)
        except ValueError as error:
            assert "history.safetensors is not a whole classifier" in str(error)
            assert "--resume" in str(error)
        else:  # white space of the header
            unharmed += 1
            assert again.probability(ROWS).tobytes() == fitted().probability(ROWS).tobytes()
            assert again.quality == fitted().quality
    assert unharmed < 3
    for damaged in (content[:-1], content[: len(content) // 2], b"", b"{}"):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match="not a whole classifier"):
            load_classifier(path)
    path.unlink()
    with pytest.raises(FileNotFoundError, match="there is no classifier"):
        load_classifier(path)


def test_the_header_and_the_hash_of_a_file(tmp_path):
    """Files that were written before must load, with the same hash."""
    path = tmp_path / "history.safetensors"
    save_classifier(fitted(), path)
    with safe_open(path, framework="np") as file:
        header = json.loads(file.metadata()["surefoot"])
        arrays = [file.get_tensor(f"{kind}{n}") for n in range(3) for kind in ("weight", "bias")]
    assert list(header) == ["format", "figures", "sha256"]
    assert list(header["figures"]) == [
        "rows", "share_yes", "seed", "held_out", "held_out_yes", "alarm", "recall", "precision",
        "share_said", "average_precision",
    ]  # fmt: skip
    content = hashlib.sha256(json.dumps(header["figures"], sort_keys=True).encode())
    for array in arrays:
        content.update(array.tobytes())
    assert header["sha256"] == content.hexdigest() == digest(fitted())


def test_without_rows_held_out_the_file_says_only_what_it_was_trained_on(tmp_path):
    rows, positive, _ = toy(100)
    classifier = fit_classifier(rows, positive, np.zeros(100, bool), seed=4)
    expected = ClassifierQuality(rows=100, share_yes=float(positive.mean()), seed=4)
    assert classifier.quality == expected
    path = tmp_path / "history.safetensors"
    save_classifier(classifier, path)
    with safe_open(path, framework="np") as file:
        header = json.loads(file.metadata()["surefoot"])
    assert list(header["figures"]) == ["rows", "share_yes", "seed"]
    assert load_classifier(path).quality == expected


def test_a_file_of_another_version_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "history.safetensors"
    monkeypatch.setattr("surefoot.learning.classifier.FORMAT", FORMAT + 1)
    save_classifier(fitted(), path)
    monkeypatch.undo()
    with pytest.raises(ValueError, match="of another version"):
        load_classifier(path)


def test_a_classifier_is_pickled_without_its_session():
    classifier = Classifier(fitted().layers, fitted().quality)
    before = pickle.dumps(classifier)
    expected = classifier.probability(ROWS)  # makes a session, which cannot be pickled
    assert pickle.dumps(classifier) == before
    again = pickle.loads(before)
    assert again.quality == classifier.quality
    assert again.probability(ROWS).tobytes() == expected.tobytes()


def small_classifier(*sizes):
    """A classifier of layers of these sizes."""
    layers = tuple(
        (np.ones(pair, np.float32), np.ones(pair[1], np.float32)) for pair in pairwise(sizes)
    )
    return Classifier(layers, UNJUDGED)


def test_another_number_of_inputs_than_asked_for_is_refused(tmp_path):
    path = tmp_path / "history.safetensors"
    save_classifier(small_classifier(47, 4, 1), path)
    load_classifier(path, 47)
    with pytest.raises(ValueError, match=r"history\.safetensors .*has 47 inputs, expected 470"):
        load_classifier(path, 470)


@pytest.mark.parametrize("sizes", [(5, 4, 2), (5,), (0, 1)])
def test_layers_that_do_not_make_a_classifier_are_refused(tmp_path, sizes):
    path = tmp_path / "history.safetensors"
    save_classifier(small_classifier(*sizes), path)
    with pytest.raises(ValueError, match="not a whole classifier"):
        load_classifier(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda layers: layers[1][0].resize((4, 3), refcheck=False), r"weight0 has shape \(5, 3\)"),
        (lambda layers: layers[0][0].fill(np.nan), "weight0 has numbers that are not finite"),
    ],
)
def test_layers_that_do_not_fit_or_are_not_finite_are_refused(tmp_path, change, message):
    path = tmp_path / "history.safetensors"
    classifier = small_classifier(5, 3, 1)
    change(classifier.layers)
    save_classifier(classifier, path)
    with pytest.raises(ValueError, match=rf"not a whole classifier.*{message}"):
        load_classifier(path)


def test_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "history.safetensors")
    with pytest.raises(ValueError, match="not a regular file"):
        load_classifier(tmp_path / "history.safetensors")


def test_a_classifier_does_not_change_with_its_file(tmp_path):
    path = tmp_path / "history.safetensors"
    save_classifier(fitted(), path)
    classifier = load_classifier(path)
    with path.open("r+b") as stream:
        stream.truncate(0)
    assert digest(classifier) == digest(fitted())
