"""The package's log is shown while a command runs, and only then."""

import logging

from surefoot.cli.progress import log_shown

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
