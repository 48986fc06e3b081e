"""The small network of the gates: it learns, says how well, and is a file to the bit."""

import pickle

import numpy as np
import pytest
import torch

from surefoot.learning.classifier import (
    FORMAT,
    Classifier,
    fit_classifier,
    judged,
    load_classifier,
    save_classifier,
)


def toy(n=4000, seed=0, share=0.5):
    """Yes inside a shell around the origin; what no linear rule can tell. One input is constant."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 6)).astype(np.float32) * [1, 10, 0.1, 1, 1, 1] + [0, 5, 0, 0, 0, 0]
    radius = (x[:, 0] ** 2) + ((x[:, 1] - 5) / 10) ** 2
    yes = radius < np.quantile(radius, share)
    x[:, 5] = 3.0
    held = np.arange(n) % 5 == 0
    return x.astype(np.float32), yes, held


def probabilities(layers, rows):
    """The network in float64, by hand."""
    x = rows.astype(np.float64)
    for number, (weight, bias) in enumerate(layers):
        x = x @ weight.astype(np.float64) + bias
        if number < len(layers) - 1:
            x = np.maximum(x, 0.0)
    return 1.0 / (1.0 + np.exp(-x[:, 0]))


def test_it_learns_a_rule_that_no_line_draws():
    rows, yes, held = toy(20_000)
    classifier = fit_classifier(rows, yes, held, seed=0)
    figures = classifier.figures
    assert figures["recall"] > 0.9
    assert figures["precision"] > 0.9
    assert figures["average_precision"] > 0.95
    assert figures["rows"] == 16_000
    assert figures["share_yes"] == pytest.approx(yes[~held].mean())


def test_its_figures_are_those_of_the_rows_held_out():
    rows, yes, held = toy(share=0.2)
    yes = yes ^ (np.random.default_rng(1).random(len(yes)) < 0.1)  # not to be learned
    for alarm in (0.2, 0.5):
        classifier = fit_classifier(rows, yes, held, seed=0, alarm=alarm)
        said = classifier.probability(rows[held]) > alarm
        true = yes[held]
        figures = classifier.figures
        assert figures["alarm"] == alarm
        assert figures["held_out"] == 800
        assert figures["held_out_yes"] == true.sum()
        assert figures["recall"] == pytest.approx((said & true).sum() / true.sum())
        assert figures["precision"] == pytest.approx((said & true).sum() / said.sum())
        assert figures["share_said"] == pytest.approx(said.mean())
        assert 0.3 < figures["precision"] < 1.0


def test_judgement_of_scores_by_hand():
    score = np.array([0.9, 0.8, 0.7, 0.6, 0.1], np.float32)
    yes = np.array([True, False, True, False, True])
    figures = judged(score, yes, 0.65)
    assert figures["recall"] == pytest.approx(2 / 3)
    assert figures["precision"] == pytest.approx(2 / 3)
    assert figures["share_said"] == pytest.approx(3 / 5)
    assert figures["average_precision"] == pytest.approx((1 + 2 / 3 + 3 / 5) / 3)
    turned = judged(score[::-1], yes[::-1], 0.65)
    assert turned == figures
    nothing = judged(score, np.zeros(5, bool), 0.95)
    assert [nothing[key] for key in ("recall", "precision", "average_precision")] == [0.0] * 3


def test_held_out_rows_teach_nothing():
    rows, yes, held = toy(1000)
    layers = fit_classifier(rows, yes, held, seed=0).layers
    other = fit_classifier(
        np.where(held[:, None], np.float32(9.0), rows), yes ^ held, held, seed=0
    ).layers
    for one, two in zip(layers, other, strict=True):
        assert [a.tobytes() for a in one] == [a.tobytes() for a in two]


def test_probabilities_are_as_frequent_as_they_say():
    """Also of what is rare: rows are not weighted."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(40_000, 3)).astype(np.float32)
    chance = 1 / (1 + np.exp(4.5 - 2.0 * rows[:, 0]))  # 5 % on the whole
    yes = rng.random(len(rows)) < chance
    held = np.arange(len(rows)) % 4 == 0
    said = fit_classifier(rows, yes, held, seed=0).probability(rows[held])
    assert yes.mean() < 0.06
    assert said.mean() == pytest.approx(yes[held].mean(), rel=0.15)
    high = said > 0.25
    assert yes[held][high].mean() == pytest.approx(said[high].mean(), rel=0.2)


def test_the_same_seed_gives_the_same_bits_and_leaves_torch_alone():
    rows, yes, held = toy(1000)
    threads, state = torch.get_num_threads(), torch.random.get_rng_state()
    first = fit_classifier(rows, yes, held, seed=3)
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.random.get_rng_state(), state)
    torch.manual_seed(99)
    again, other = (fit_classifier(rows, yes, held, seed) for seed in (3, 4))
    assert again.figures == first.figures
    for (weight, bias), (w, b), (different, _) in zip(
        first.layers, again.layers, other.layers, strict=True
    ):
        assert weight.tobytes() == w.tobytes()
        assert bias.tobytes() == b.tobytes()
        assert not np.array_equal(different, weight)


def test_its_probability_is_the_network_s():
    rows, yes, held = toy(1000)
    classifier = fit_classifier(rows, yes, held, seed=0)
    expected = probabilities(classifier.layers, rows)
    np.testing.assert_allclose(classifier.probability(rows), expected, atol=1e-5)
    assert classifier.probability(rows[:0]).shape == (0,)


def test_a_row_s_probability_depends_on_it_alone():
    rows, yes, held = toy(1000)
    classifier = fit_classifier(rows, yes, held, seed=0)
    together = classifier.probability(rows[:40])
    for some in (slice(0, 1), slice(3, 8), slice(11, 40)):
        np.testing.assert_array_equal(classifier.probability(rows[some]), together[some])
    broken = rows[:40].copy()
    broken[7] = [np.nan, np.inf, -np.inf, 3e38, 0, 0]
    others = np.arange(40) != 7
    np.testing.assert_array_equal(classifier.probability(broken)[others], together[others])


@pytest.mark.parametrize("answer", [True, False])
def test_what_is_always_or_never_so_is_learned_too(answer):
    rows, _, held = toy(1000)
    classifier = fit_classifier(rows, np.full(1000, answer), held, seed=0)
    said = classifier.probability(rows)
    assert np.isfinite(said).all()
    assert (said > 0.5).all() == answer
    assert (said < 0.5).all() != answer


def test_too_few_rows_are_an_error():
    rows, yes, _ = toy(10)
    with pytest.raises(ValueError, match="7 rows are too few"):
        fit_classifier(rows, yes, np.arange(10) < 3, seed=0)
    with pytest.raises(ValueError, match="0 rows are too few"):
        fit_classifier(rows, yes, np.ones(10, bool), seed=0)


# --- files and processes


CLASSIFIER = fit_classifier(*toy(1000), seed=0)
ROWS = toy(50, seed=5)[0]


def test_a_file_brings_it_back_to_the_bit(tmp_path):
    path = tmp_path / "gates" / "history-001.safetensors"
    path.parent.mkdir()
    save_classifier(CLASSIFIER, path)
    again = load_classifier(path)
    assert again.figures == CLASSIFIER.figures
    assert len(again.layers) == len(CLASSIFIER.layers) == 3
    assert again.probability(ROWS).tobytes() == CLASSIFIER.probability(ROWS).tobytes()
    content = path.read_bytes()
    save_classifier(again, path)
    assert path.read_bytes() == content


def test_any_changed_byte_is_refused(tmp_path):
    path = tmp_path / "history.safetensors"
    save_classifier(CLASSIFIER, path)
    content = path.read_bytes()
    rng, unharmed = np.random.default_rng(0), 0
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
            assert again.probability(ROWS).tobytes() == CLASSIFIER.probability(ROWS).tobytes()
            assert again.figures == CLASSIFIER.figures
    assert unharmed < 3
    for damaged in (content[:-1], content[: len(content) // 2], b"", b"{}"):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match="not a whole classifier"):
            load_classifier(path)
    path.unlink()
    with pytest.raises(FileNotFoundError, match="there is no classifier"):
        load_classifier(path)


def test_a_file_of_another_version_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "history.safetensors"
    monkeypatch.setattr("surefoot.learning.classifier.FORMAT", FORMAT + 1)
    save_classifier(CLASSIFIER, path)
    monkeypatch.undo()
    with pytest.raises(ValueError, match="of another version"):
        load_classifier(path)


def test_it_goes_to_other_processes_without_its_session():
    classifier = Classifier(CLASSIFIER.layers, CLASSIFIER.figures)
    before = pickle.dumps(classifier)
    expected = classifier.probability(ROWS)  # makes a session, which cannot be pickled
    assert pickle.dumps(classifier) == before
    again = pickle.loads(before)
    assert again.figures == classifier.figures
    assert again.probability(ROWS).tobytes() == expected.tobytes()
