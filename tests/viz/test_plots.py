"""Learning curves of finished, unfinished and single-iteration runs."""

import matplotlib.image
import pytest
from matplotlib.figure import Figure

from surefoot.runs.metrics import Best, Collected, StageRecord
from surefoot.viz.plots import learning_curves, save_figure
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


@pytest.fixture
def figures(monkeypatch) -> list[Figure]:
    """The figures that are saved from now on."""
    saved = []
    savefig = Figure.savefig

    def save_and_keep(figure, *args, **options):
        saved.append(figure)
        savefig(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", save_and_keep)
    return saved


@pytest.mark.parametrize(
    ("metrics", "validated", "best"),
    [
        pytest.param([*records(4), Best(best_iteration=2)], [0, 1, 2, 3], 2, id="finished"),
        pytest.param([*records(1), Best(best_iteration=0)], [0], 0, id="behavior_cloning"),
        pytest.param(records(3)[:-2], [0, 1], None, id="unfinished"),
        pytest.param(records(1)[:1], [], None, id="only collected"),
        pytest.param(records(40), [*range(40)], None, id="long"),
    ],
)
def test_a_run_in_any_state_is_drawn_as_far_as_it_is_done(
    figures, tmp_path, metrics, validated, best
):
    path = learning_curves(metrics, tmp_path / "curves.png")
    picture = matplotlib.image.imread(path)
    assert picture.shape[0] > 900 and picture.shape[1] > 900
    assert [file.name for file in tmp_path.iterdir()] == ["curves.png"]
    falls, share, success = figures[0].axes
    collected = [record for record in metrics if isinstance(record, Collected)]
    everywhere = [record.iteration for record in collected]
    assert falls.lines[0].get_xydata().tolist() == [[i, 3 * i] for i in everywhere]
    assert falls.lines[1].get_xydata().tolist() == [[i, i] for i in everywhere]
    later = [[i, pytest.approx(30 / i)] for i in everywhere if i > 0]
    assert share.lines[1].get_xydata().tolist() == later
    texts = [text.get_text() for text in success.texts]
    if validated:
        assert success.lines[0].get_xydata().tolist() == [[i, 90.0] for i in validated]
        assert texts == ([] if best is None else ["best: 90 %"])
    else:
        assert texts == ["not validated yet"]
    if best is not None:
        assert success.texts[0].xy == (best, 83.0)


def test_a_series_of_dataset_sizes_has_all_its_policies_in_the_picture(figures, tmp_path):
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


def test_the_expert_alone_does_not_squash_the_later_shares(figures, tmp_path):
    learning_curves(records(3), tmp_path / "several.png")
    learning_curves(records(1), tmp_path / "one.png")
    several, one = (figure.axes[1].get_ylim()[1] for figure in figures)
    assert 30 < several < 50  # the largest share drawn is 36 %
    assert one > 100


def test_a_failure_leaves_the_old_picture_and_nothing_else(monkeypatch, tmp_path):
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


def test_another_format_than_the_name_says_is_not_written(tmp_path):
    for name in ("curves.jpg", "curves"):
        with pytest.raises(ValueError, match=rf"{name} must end in .png or .svg"):
            save_figure(Figure(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_link_stays_and_its_target_gets_the_plot(tmp_path):
    link = tmp_path / "curves.png"
    link.symlink_to(tmp_path / "elsewhere")
    save_figure(Figure(), link)
    assert link.is_symlink()
    assert (tmp_path / "elsewhere").read_bytes().startswith(b"\x89PNG")
