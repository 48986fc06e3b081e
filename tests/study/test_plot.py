"""The plot of whole and unfinished comparisons."""

from dataclasses import replace

import pytest

from surefoot.config.json_io import read_record
from surefoot.study.plot import comparison_figure
from surefoot.study.records import Comparison, Row
from tests.fakes.comparisons import Interrupted, measure, pretend_measurements


def test_the_plot_shows_every_row_and_is_the_same_each_time(monkeypatch, runs, tmp_path):
    pretend_measurements(monkeypatch)
    comparison = measure(runs)
    text = comparison_figure(comparison, tmp_path / "figure.svg").read_text()
    for part in ("MuJoCo", "PyBullet", "LocoSafeDAGGER, bounds", "forward", "100 % survive"):
        assert part in text
    assert comparison_figure(comparison, tmp_path / "again.svg").read_text() == text


def test_the_plot_of_an_unfinished_comparison_shows_what_is_measured(monkeypatch, runs, tmp_path):
    path = tmp_path / "part.json"
    pretend_measurements(monkeypatch, stop_after=3)
    with pytest.raises(Interrupted):
        measure(runs, path)
    text = comparison_figure(read_record(path, Comparison), tmp_path / "figure.svg").read_text()
    assert "MuJoCo" in text and "PyBullet" not in text


def test_without_pushes_there_are_no_directions(monkeypatch, runs, tmp_path):
    pretend_measurements(monkeypatch)
    comparison = measure(runs, pushes=False)
    text = comparison_figure(comparison, tmp_path / "figure.svg").read_text()
    assert "MuJoCo" in text and "forward" not in text


def test_a_comparison_without_measurements_has_no_plot(monkeypatch, runs, tmp_path):
    pretend_measurements(monkeypatch)
    comparison = replace(measure(runs), rows=(Row("expert"),))
    with pytest.raises(ValueError, match="nothing to draw"):
        comparison_figure(comparison, tmp_path / "figure.svg")
    assert not (tmp_path / "figure.svg").exists()


def test_labels_are_no_mathematics(monkeypatch, runs, tmp_path):
    pretend_measurements(monkeypatch)
    comparison = measure(runs)
    first, *others = comparison.rows
    odd = replace(comparison, rows=(replace(first, label="a$_$b"), *others))
    assert "a$_$b" in comparison_figure(odd, tmp_path / "figure.svg").read_text()
