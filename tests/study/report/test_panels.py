"""The figures of a study: what the paper counts, the best policies, and what is missing."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from surefoot.config.study import Measurement, Setting
from surefoot.evaluation.imitation import ImitationError
from surefoot.study import folder as study_folder
from surefoot.study.report.collecting import collecting_figures
from surefoot.study.report.drawing import draw
from surefoot.study.report.numbers import Number
from surefoot.study.report.panels import RunPoint, group_of
from surefoot.study.report.performance import performance_figures
from surefoot.study.report.pictures import inline_svg
from surefoot.study.results import read_results
from surefoot.study.run_statistics import mean_of_runs
from surefoot.study.run_values import best_value
from tests.fakes.runs import collected_record
from tests.fakes.study_folders import paper_like, write_study


@pytest.fixture(scope="module")
def results(study_folder):
    return read_results(study_folder)


def with_collections(results, technique, records):
    """The results with one run of a technique that has these records."""
    cells = [
        replace(cell, metrics=records)
        for cell in results.of(technique, "all")
        if cell.cell.seed == 0
    ]
    return replace(results, cells=tuple(cells))


@pytest.mark.parametrize(
    ("technique", "failed"), [("loco_dagger-0.5", 0.5), ("loco_safe_dagger", 0.25)]
)
def test_falls_of_the_expert_are_no_failures_in_the_papers_count(results, technique, failed):
    record = collected_record(1, episodes=8, falls=5, falls_expert_driving=3, diverged=2)
    [figure, _] = collecting_figures(with_collections(results, technique, (record,)))
    [[paper, physical]] = figure.rows
    assert [curve.groups[0].runs[0].y.value for curve in paper.curves] == [failed]
    assert [curve.groups[0].runs[0].y.value for curve in physical.curves] == [5 / 8]


def test_pretraining_is_no_iteration_of_the_figures(results):
    for figure in collecting_figures(results):
        for panel in figure.panels:
            assert [curve.technique for curve in panel.curves] == [
                "loco_dagger-0.5",
                "loco_dagger-0.8",
                "loco_safe_dagger",
            ]
            for curve in panel.curves:
                assert [group.label for group in curve.groups] == ["iteration 1", "iteration 2"]


def test_the_papers_figures_and_the_best_policies_are_there(results):
    names = [figure.name for figure in performance_figures(results)]
    assert names == [
        *("3-success-test", "4-tracking-test", "5-pushes-push", "6-mean-push-push", "7-best")
    ]


def test_only_captions_of_figures_with_the_expert_name_its_line(results):
    line = "The dotted line is the expert."
    assert all(figure.caption.endswith(line) for figure in performance_figures(results))
    techniques = tuple(each for each in results.study.techniques if each.method != "expert")
    study = replace(results.study, techniques=techniques)
    alone = replace(results, setup=replace(results.setup, study=study))
    figures = performance_figures(alone)
    assert figures
    assert not any(line in figure.caption for figure in figures)


def with_successes(figure, successes):
    """A figure of success of 10 episodes, in which each run has succeeded so often."""
    [[panel]] = figure.rows
    points = [
        RunPoint(seed, Number(1000.0, "x"), Number(count / 10, "y", 10))
        for seed, count in enumerate(successes)
    ]
    curve = replace(panel.curves[0], groups=(group_of("best policy", points),))
    return replace(figure, rows=((replace(panel, curves=(curve,), reference=None),),))


@pytest.mark.parametrize("successes", [(0, 0), (10, 10)])
def test_the_intervals_of_shares_that_are_the_same_are_not_cut(results, successes):
    figure = with_successes(performance_figures(results)[0], successes)
    [axes] = draw(figure).axes
    [group] = figure.curves[0].groups
    assert group.estimate is not None
    assert group.estimate.low is not None and group.estimate.high is not None
    low, high = axes.get_ylim()
    assert low <= 100 * group.estimate.low.value
    assert 100 * group.estimate.high.value <= high


def test_every_run_is_a_point_and_a_missing_one_is_left_out(results):
    success, *_ = performance_figures(results)
    [[panel]] = success.rows
    points = {curve.technique: len(curve.groups[-1].runs) for curve in panel.curves}
    assert points == {
        "behavior_cloning": 2,
        "loco_dagger-0.5": 2,
        "loco_dagger-0.8": 1,
        "loco_safe_dagger": 2,
    }
    assert panel.reference is not None
    assert panel.reference.groups[0].runs[0].y.value == 1.0


def test_settings_are_small_multiples(tmp_path):
    study = paper_like(1)
    settings = (Setting("low", "low"), Setting("high", "high", {"chunk": 7}))
    techniques = study.techniques[:2]
    study = replace(
        study,
        techniques=techniques,
        settings=settings,
        comparisons=(),
        claims="none",
        seeds=(0,),
    )
    results = read_results(write_study(tmp_path / "two", study, iterations=1))
    success, tracking, *_, best = performance_figures(results)
    assert [panel.title for panel in success.panels] == ["low", "high"]
    assert len(tracking.rows) == 4
    assert [row[1].title for row in best.rows] == [
        "low: 100 initial states, 5 s, in MuJoCo",
        "high: 100 initial states, 5 s, in MuJoCo",
    ]


def test_a_picture_has_the_colors_of_the_page_and_a_text(results):
    _, figure = collecting_figures(results)
    picture = inline_svg(draw(figure), figure)
    assert "var(--ink)" in picture and "var(--technique-3)" in picture
    assert "#0072b2" not in picture
    assert 'role="img"' in picture and "Share of the MPC while collecting data" in picture


def test_trainings_of_a_seed_are_one_run_in_figures_as_in_verdicts(tmp_path):
    study = paper_like(1)
    cloning = replace(study.technique("behavior_cloning"), trainings=2)
    study = replace(study, techniques=(cloning,), comparisons=(), seeds=(0, 1), claims="none")
    results = read_results(write_study(tmp_path / "two", study, iterations=1))
    best = performance_figures(results)[-1]
    [group] = best.panels[0].curves[0].groups
    assert [run.seed for run in group.runs] == [0, 1]
    measurement = next(each for each in study.measurements if each.measure == "robustness")
    runs = best_value(results.cells, measurement.name, "robustness")
    assert group.estimate is not None and runs is not None
    assert group.estimate.low is not None and group.estimate.high is not None
    means = mean_of_runs(runs)
    assert [run.y.value for run in group.runs] == pytest.approx(means.runs)
    ends = (group.estimate.low.value, group.estimate.high.value)
    assert ends == pytest.approx(means.interval)


def test_the_deviation_from_the_expert_is_shown_and_judged(results):
    imitation = Measurement("imitation", "states of a pushed expert", "imitation")
    study = replace(results.study, measurements=(*results.study.measurements, imitation))
    cells = tuple(replace(cell, tests={"imitation": deviation(cell)}) for cell in results.cells)
    results = replace(results, setup=replace(results.setup, study=study), cells=cells)
    figure = performance_figures(results)[-1]
    [panel] = figure.panels
    shown = {curve.technique: curve.groups[0].runs[0].y.value for curve in panel.curves}
    assert set(shown.values()) == {79.5}
    cloning = results.of("behavior_cloning", "all")
    runs = best_value(cloning, "imitation", "imitation")
    assert runs is not None and set(runs.values) == {79.5}


def deviation(cell):
    """The deviation from the expert of the best policy of a cell."""
    best = cell.best_test("test")
    error = ImitationError("starts", "hash", 60, 4800, 79.5, 425.0, None)
    policy = replace(best, robustness=None, pushes=None, imitation=error)
    return study_folder.Tests("imitation", (policy,), finished=True)


def test_the_names_of_many_techniques_do_not_overlap(results):
    figure = next(each for each in performance_figures(results) if each.kind == "techniques")
    panel = figure.rows[0][0]
    long_title = "LocoSafeDAGGER, pushed: full state and history"
    many = [
        replace(panel.curves[0], technique=f"technique {number}", title=f"{long_title} {number}")
        for number in range(12)
    ]
    crowded = replace(panel, curves=tuple(many))
    fewer = replace(panel, curves=tuple(many[6:]))
    drawn = draw(replace(figure, rows=((fewer, crowded, crowded, crowded),)))
    for axes, is_first in zip(drawn.axes, (True, False, False, True), strict=True):
        names = [name for name in axes.get_yticklabels() if name.get_visible()]
        assert len(names) == (len(many) if is_first else 0)
        boxes = sorted((name.get_window_extent() for name in names), key=lambda box: box.y0)
        assert all(below.y1 < above.y0 for below, above in pairwise(boxes))
        assert all(box.x0 >= 0.0 for box in boxes)


def test_a_technique_has_the_same_line_in_all_panels_also_where_others_are_not_measured(results):
    figure = next(each for each in performance_figures(results) if each.kind == "techniques")
    whole = replace(figure.rows[0][0], reference=None)
    part = replace(whole, curves=whole.curves[-1:])
    nothing = replace(whole, curves=())
    drawn = draw(replace(figure, rows=((nothing, whole, part),)))
    names = [name.get_text().replace(r"\$", "$") for name in drawn.axes[0].get_yticklabels()]
    assert names == [curve.title for curve in whole.curves]
    lowest = [max(np.max(line.get_ydata()) for line in axes.lines) for axes in drawn.axes[1:]]
    assert lowest[0] == lowest[1] > len(names) - 1.5
