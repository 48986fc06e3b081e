"""A study's tables in Markdown: a row for each technique, the means and every run, the prose."""

from dataclasses import replace

from surefoot.config.studies import regimes_study
from surefoot.config.study import Measurement
from surefoot.runs.metrics import Collected
from surefoot.study.cells import cells_of
from surefoot.study.paper_claims import paper_claims
from surefoot.study.report.markdown_page import page_of_tables
from surefoot.study.report.study_page import study_report
from tests.fakes.studies import FakeRun, study_results

STUDY = regimes_study()
SETTINGS = STUDY.settings[:1]
PLANNED = tuple(each for each in STUDY.comparisons if each.setting == SETTINGS[0].name)
SMALL = replace(STUDY, settings=SETTINGS, seeds=(0, 1), comparisons=PLANNED)
PROSE = "# A page\n\n<!-- table -->\nold\n<!-- end of table -->\n\nWhat it means.\n"


def regimes(**runs):
    """Results of the regimes' first setting, with two seeds."""
    return study_results(runs, SMALL)


def page(results, path):
    """The page of these results, where there is a page with prose already."""
    path.write_text(PROSE)
    return page_of_tables(results, study_report(results), path)


def test_a_technique_is_a_row_with_its_mean_and_every_run(tmp_path):
    runs = [FakeRun(falls=(2, 1), plans=(100, 100), successes=(80, 96))]
    runs.append(replace(runs[0], falls=(0, 0), successes=(80, 86)))
    text = page(regimes(loco_safe_dagger=runs), tmp_path / "page.md")
    row = next(line for line in text.splitlines() if line.startswith("| LocoSafeDAGGER |"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1].startswith("**91** [") and cells[1].endswith("]: 96, 86")
    assert cells[-2] == "1.5"  # falls: 3 and 0
    assert cells[-3] == "–, 2.00, 3.00"  # no speed error is stored along x


def test_trainings_of_one_seed_cost_as_one_run(tmp_path):
    techniques = tuple(
        replace(each, trainings=2) if each.name == "dagger" else each for each in SMALL.techniques
    )
    twice = replace(SMALL, techniques=techniques)
    runs = [FakeRun(falls=(3,)), FakeRun(falls=(3,)), FakeRun(falls=(0,))]  # of seeds 0, 0, 1
    text = page(study_results({"dagger": runs}, twice), tmp_path / "page.md")
    row = next(line for line in text.splitlines() if line.startswith("| DAGGER |"))
    assert row.strip("| ").split(" | ")[-2] == "1.5"


def test_seeds_with_the_same_data_are_named(tmp_path):
    """As of cloning without a budget or pushes; several trainings of one seed are no seeds."""
    said = "The seeds of DAGGER have the same data: these runs differ in their trainings alone"
    same = regimes(dagger=[FakeRun(falls=(0,)), FakeRun(falls=(0,))])
    assert said in page(same, tmp_path / "page.md")
    last = same.cells[-1]
    other = tuple(
        replace(each, dataset_hash="c0ffee") if isinstance(each, Collected) else each
        for each in last.metrics
    )
    differing = replace(same, cells=(*same.cells[:-1], replace(last, metrics=other)))
    assert "the same data" not in page(differing, tmp_path / "page.md")
    assert "the same data" not in page(regimes(dagger=[FakeRun(falls=(0,))]), tmp_path / "page.md")


def test_titles_of_settings_keep_their_capitals(tmp_path):
    setting = replace(SETTINGS[0], title="pushed by 2 N s in PyBullet")
    named = replace(SMALL, settings=(setting,))
    text = page(study_results({"dagger": [FakeRun(falls=(0,))]}, named), tmp_path / "page.md")
    assert "### Pushed by 2 N s in PyBullet\n" in text


def test_the_prose_stays_and_the_old_tables_go(tmp_path):
    text = page(regimes(dagger=[FakeRun(falls=(0,))]), tmp_path / "page.md")
    assert text.startswith("# A page") and text.endswith("What it means.\n")
    assert "\nold\n" not in text


def test_what_is_not_measured_is_not_there_and_the_page_says_how_much_is(tmp_path):
    results = regimes(dagger=[FakeRun(falls=(0,))])
    text = page(results, tmp_path / "page.md")
    assert "| DAGGER |" in text and "| DART |" not in text
    cells = [cell.name for cell in cells_of(results.study)]
    trained = [name for name in cells if not name.endswith("expert")]
    complete = set(trained) - set(results.missing)
    about = f"{len(complete)} of {len(trained)} trainings of commit 0123456789ab are complete"
    assert about in text and len(trained) < len(cells)


def test_the_papers_claims_stand_in_a_table(tmp_path):
    results = study_results({"loco_safe_dagger": [FakeRun(falls=(0, 0), share=(0.1, 0.1))]})
    text = page(results, tmp_path / "page.md")
    claims = paper_claims(results)
    assert "\n1 finished run of commit 0123456789ab, seeds " in text
    assert "\n| claim | section | verdict | measured | why |\n" in text
    assert len({claim.number for claim in claims}) > 1
    for each in claims:
        row = (each.text, each.section, f"**{each.verdict}**", each.number, each.reason)
        assert f"\n| {' | '.join(row)} |\n" in text


def test_planned_comparisons_stand_below_with_their_verdicts(tmp_path):
    text = page(regimes(dagger=[FakeRun(falls=(0,))]), tmp_path / "page.md")
    below = text[text.index("### Planned comparisons") :]
    assert below.count("**cannot tell**") == len(PLANNED) > 0
    assert "| setting |" not in below


def test_planned_comparisons_say_their_settings_where_there_are_several(tmp_path):
    results = study_results({}, replace(STUDY, seeds=(0, 1)))
    text = page(results, tmp_path / "page.md")
    below = text[text.index("### Planned comparisons") :]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in below.splitlines()]
    rows = [row for row in rows if len(row) > 1]
    place = rows[0].index("setting")
    found = [row[place] for row in rows[2:]]
    assert found == [STUDY.setting(each.setting).title for each in STUDY.comparisons]
    assert len(set(found)) > 1


def test_what_came_of_the_predictions_stands_between_tables_and_comparisons(tmp_path):
    results = regimes(dagger=[FakeRun(falls=(0,))])
    report = study_report(results)
    path = tmp_path / "page.md"
    path.write_text(PROSE)
    assert "**not judged yet**" in page_of_tables(results, report, path)
    [first, *others] = report.predictions
    judged = (replace(first, verdict="false", came_out="3 of 100"), *others)
    text = page_of_tables(results, replace(report, predictions=judged), path)
    below = text[text.index("### What was predicted") : text.index("### Planned comparisons")]
    assert f"| {first.prediction} | **false** | 3 of 100 |" in below
    assert below.count("**not judged yet**") == len(others)


def test_impulses_that_robots_withstand_have_a_column_in_newtons_seconds(tmp_path):
    push = Measurement("push", "largest impulse", "impulse")
    pushed = replace(SMALL, measurements=(*SMALL.measurements, push))
    runs = [FakeRun(falls=(0,), impulse=(2.0, 2.0)), FakeRun(falls=(0,), impulse=(3.0, 3.5))]
    text = page(study_results({"dagger": runs}, pushed), tmp_path / "page.md")
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    column = next(row for row in rows if "technique" in row).index("largest impulse [N s]")
    cell = next(row for row in rows if "DAGGER" in row)[column]
    assert cell.startswith("**2.62** [") and cell.endswith("]: 2.00, 3.25")
    assert "in percent or in N s" in text
