"""Learning curves of finished, unfinished and single-iteration runs."""

import matplotlib.image
import pytest

from surefoot.runs.metrics import Best, StageRecord
from surefoot.viz.plots import learning_curves
from tests.fakes.runs import collected_record, trained_record, validated_record


def records(iterations: int) -> list[StageRecord]:
    made = []
    for i in range(iterations):
        share = 1.0 if i == 0 else 0.3 / i
        frames = 165_000 + 60_000 * i
        made.append(
            collected_record(
                i,
                falls=3 * i,
                falls_expert_driving=i,
                dataset_frames=frames,
                expert_share=share,
                expert_share_with_tail=(10 * share + 1) / 11,
            )
        )
        made.append(trained_record(i, frames=frames))
        made.append(validated_record(i, success_rate=0.9, success_interval=(0.83, 0.94)))
    return made


@pytest.mark.parametrize(
    "metrics",
    [
        pytest.param([*records(4), Best(best_iteration=2)], id="finished"),
        pytest.param([*records(1), Best(best_iteration=0)], id="behavior_cloning"),
        pytest.param(records(3)[:-2], id="unfinished"),
        pytest.param(records(1)[:1], id="only collected"),
        pytest.param(records(40), id="long"),
    ],
)
def test_a_run_in_any_state_gives_a_picture(tmp_path, metrics):
    path = learning_curves(metrics, tmp_path / "curves.png")
    picture = matplotlib.image.imread(path)
    assert picture.shape[0] > 900 and picture.shape[1] > 900
    assert picture[..., :3].std() > 0.01
    assert [file.name for file in tmp_path.iterdir()] == ["curves.png"]


def test_a_series_of_dataset_sizes_has_all_its_policies_in_the_picture(monkeypatch, tmp_path):
    from matplotlib.figure import Figure

    figures = []
    draw = Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *a, **k: (figures.append(self), draw(self, *a, **k))[1]
    )
    series: list[StageRecord] = [collected_record(0)]
    for size in range(3):
        series += [trained_record(size, frames=7000), validated_record(size)]
    learning_curves(series, tmp_path / "curves.png")
    labels = [tick.get_text() for tick in figures[0].axes[-1].get_xticklabels()]
    assert labels == ["0\n7k", "1\n7k", "2\n7k"]
    assert figures[0].axes[-1].get_xlim() == (-0.5, 2.5)


def test_svg_names_its_panels_and_is_the_same_each_time(tmp_path):
    metrics = records(3)
    first = learning_curves(metrics, tmp_path / "a.svg").read_bytes()
    assert first.startswith(b"<?xml")
    for text in (b"falls per iteration", b"share of time [%]", b"success [%]"):
        assert text in first
    assert learning_curves(metrics, tmp_path / "b.svg").read_bytes() == first


def test_the_expert_alone_does_not_squash_the_later_shares(monkeypatch, tmp_path):
    from matplotlib.figure import Figure

    limits = {}

    def look(figure, *_args, **_kwargs):
        limits.update({axes.get_ylabel(): axes.get_ylim() for axes in figure.axes})

    monkeypatch.setattr(Figure, "savefig", lambda *a, **k: (look(*a), a[1].write_bytes(b"-")))
    learning_curves(records(3), tmp_path / "several.png")
    assert 30 < limits["share of time [%]"][1] < 50  # the largest share drawn is 36 %
    learning_curves(records(1), tmp_path / "one.png")
    assert limits["share of time [%]"][1] > 100


def test_a_failure_leaves_the_old_picture_and_nothing_else(monkeypatch, tmp_path):
    from matplotlib.figure import Figure

    path = tmp_path / "curves.png"
    path.write_bytes(b"old")

    def full(_figure, target, **_options):
        target.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(OSError, match="disk full"):
        learning_curves(records(2), path)
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


def test_a_run_without_data_is_an_error(tmp_path):
    with pytest.raises(ValueError, match="nothing to draw"):
        learning_curves([], tmp_path / "curves.png")
    assert not list(tmp_path.iterdir())
