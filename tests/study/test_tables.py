"""Tables of a comparison: known answers in every cell, and dashes."""

from dataclasses import replace

from surefoot.evaluation.latching import latching_of
from surefoot.study.records import Measured
from surefoot.study.tables import comparison_tables, share_cell
from tests.fakes.comparisons import measure, pretend_measurements
from tests.fakes.rollouts import summary_of


def cells(text: str) -> list[list[str]]:
    """The cells of a text's tables, without their heads."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in lines
        if not line.startswith(("| ---", "| simulator", "| method"))
    ]


def test_the_tables_hold_the_known_answers(monkeypatch, runs):
    pretend_measurements(monkeypatch)
    text = comparison_tables(measure(runs))
    table = cells(text)
    assert table[1] == [
        "mujoco",
        "BC",
        "2 of 4, 50.0 % (15.0 to 85.0)",
        "25.0 %",
        "1",
        "1",
        "0",
        "3, 1",
        "1.00, 2.00, 34.50",
        "-, 2.00, 3.00",
        "1.00 (1.00 to 1.00)",
        "1.00, 1.00",
    ]
    assert table[5][:3] == ["bullet", "LocoSafeDAGGER, bounds", "3 of 4, 75.0 % (30.1 to 95.4)"]
    assert table[5][4:6] == ["1", "0"]
    assert table[0][-2:] == ["3.00 (3.00 to 3.00)", "2.00, 4.00"]
    # Newcombe's intervals of two and of one discordant pair in four.
    assert table[6] == [
        "mujoco",
        "expert",
        "-",
        "+50.0 (-10.2 to +85.0)",
        "-",
        "+2.00 (-1.00 to +4.00)",
    ]
    assert table[7][2:4] == ["-50.0 (-85.0 to +10.2)", "-"]
    assert table[8][2:] == [
        "-25.0 (-69.9 to +28.1)",
        "+25.0 (-32.0 to +65.5)",
        "-2.00 (-4.00 to +1.00)",
        "+0.00 (-1.00 to +1.00)",
    ]
    assert table[12] == [
        *("BC", "0", "60", "1200", "0 of 10 (0.0 to 27.8 %)", "-", "-", "0, 0"),
        *("-", "0", "-", "-"),
        *("1000", "0.0 %, 0.0 %", "100, 20, 3, 0"),
    ]
    # 3 falls in 10 rollouts, together one minute; the expert drove 10 of 60 s.
    assert table[13][2:5] == ["70", "2400", "0 of 10 (0.0 to 27.8 %)"]
    assert table[13][5:11] == ["3 of 10 (10.8 to 60.3 %)", "3.00", "4, 2", "-", "0", "0"]
    assert table[13][11:] == ["16.7 %", "2000", "0.0 %, 0.0 %", "200, 40, 6, 1"]
    assert "80 % of 2 robots survive" in text
    assert "row minus baseline (BC)" in text


def test_without_pushes_their_cells_are_dashes(monkeypatch, runs):
    pretend_measurements(monkeypatch)
    comparison = measure(runs[1:], pushes=False, simulators=("bullet",))
    table = cells(comparison_tables(comparison))
    assert table[0][-2:] == ["-", "-"]
    assert table[2] == [
        *("bullet", "LocoSafeDAGGER, bounds", "-25.0 (-69.9 to +28.1)", "-", "-", "-")
    ]
    assert "row minus baseline (no baseline)" in comparison_tables(comparison)


def test_an_unfinished_comparison_has_tables(monkeypatch, runs):
    pretend_measurements(monkeypatch)
    comparison = measure(runs, simulators=("mujoco",))
    expert = replace(comparison.rows[0], results={"mujoco": Measured()}, differences={})
    begun = replace(comparison, rows=(expert, replace(comparison.rows[1], results={})))
    table = cells(comparison_tables(begun))
    assert table[0] == ["mujoco", "expert", *(["-"] * 10)]
    assert [row[0] for row in table[1:]] == ["BC"]  # no differences; what it cost is known


def test_a_share_of_nothing_is_a_dash():
    assert share_cell(0, 0) == share_cell(None, None) == "-"
    assert share_cell(1, 4) == "1 of 4 (4.6 to 69.9 %)"


def test_a_bar_in_a_name_does_not_break_the_table(monkeypatch, runs):
    pretend_measurements(monkeypatch)
    comparison = measure(runs, simulators=("mujoco",), names=("a|b", "two\nlines"))
    text = comparison_tables(comparison)
    assert "| mujoco | a\\|b | 2 of 4" in text
    assert "| mujoco | two lines | 3 of 4" in text


def test_under_a_hardware_profile_latches_have_columns(monkeypatch, runs):
    pretend_measurements(monkeypatch)
    plain = measure(runs)
    assert "would have latched" not in comparison_tables(plain)
    limited = measure(runs, profile="odri")
    assert limited.config.robot.profile == "odri"
    row = limited.rows[1]
    evaluation = row.results["mujoco"].evaluation
    assert evaluation is not None
    latching = latching_of(
        summary_of([0, 0, 1, 0], latch=[0, 1, 1, 2], latch_tick=[-1, 0, 9, 9], start=[5, 6, 7, 8]),
        "odri",
    )
    measured = replace(row.results["mujoco"], evaluation=replace(evaluation, latching=latching))
    rows = list(limited.rows)
    rows[1] = replace(row, results={**row.results, "mujoco": measured})
    text = comparison_tables(replace(limited, rows=tuple(rows)))
    assert "would have latched, of them successes | initial states outside the profile" in text
    assert "| 3, 2 | 1 |" in text
    assert "Torques are clipped to the hardware profile odri" in text
