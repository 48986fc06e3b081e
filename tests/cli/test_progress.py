"""The package's log is shown while a command runs, and only then."""

import logging

import pytest

from surefoot.cli.progress import duration_text, log_shown, seconds_bar

logger = logging.getLogger("surefoot.runs.stages")


def test_progress_goes_to_stdout_and_warnings_to_stderr(capsys):
    with log_shown():
        logger.debug("detail")
        logger.info("iteration %d: 3 fell", 2)
        logger.warning("other versions")
    output = capsys.readouterr()
    assert output.out == "iteration 2: 3 fell\n"
    assert output.err == "other versions\n"


def test_each_line_is_shown_once_however_often_a_command_ran(capsys):
    for _ in range(2):
        with log_shown():
            pass
    with log_shown():
        logger.info("once")
    logger.info("not shown")
    assert capsys.readouterr().out == "once\n"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(2.0, "1 minute"), (170.0, "3 minutes"), (3570.0, "60 minutes"), (5400.0, "1.5 hours")],
)
def test_durations_below_an_hour_are_minutes(seconds, text):
    assert duration_text(seconds) == text


def test_a_bar_of_simulated_time_ends_when_the_robot_stops(capsys):
    with seconds_bar(1.5, "walk") as bar:
        bar.update(1500)
        assert bar.n == bar.total
    shown = capsys.readouterr().err
    assert "walk:" in shown and "/1500 [" in shown
