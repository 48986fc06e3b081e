"""A user's own MPC as a run's expert: remembered, compared and warned of."""

import itertools
import warnings

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.mpc.gaits import with_gaits
from surefoot.runs.layout import RunError
from surefoot.runs.own_expert import check_expert, remember_expert, warn_of_own_expert
from surefoot.runs.run import Run
from surefoot.types import MotionPlan
from tests.fakes.runs import collected_record


def holding(torque: float):
    """A plan function, whose name is always the same."""
    rows = np.zeros((100, 12))
    return lambda state, tick, command: MotionPlan(rows, rows, rows + torque)


def test_the_expert_that_a_run_was_begun_with_is_accepted_and_another_one_refused(tmp_path):
    run = Run(tmp_path, Config())
    remember_expert(run, holding(1.0))
    check_expert(run, holding(1.0 + 1e-9))
    message = (
        r"was begun with the expert .*test_own_expert\.holding\.<locals>\.<lambda>, which has "
        r"changed since: .*torque is up to 0\.1 N m apart \(tolerance 1e-06\)\. Resume it with the "
        r"same one"
    )
    with pytest.raises(RunError, match=message):
        check_expert(run, holding(0.9))
    with pytest.raises(RunError, match="not with the package's own planner"):
        check_expert(run, None)


def test_the_packages_planner_leaves_no_file_and_removes_that_of_a_failed_expert(tmp_path):
    run = Run(tmp_path, Config())
    remember_expert(run, holding(1.0))
    assert run.expert_path.exists()
    remember_expert(run, None)
    assert not run.expert_path.exists()


def test_a_run_of_an_earlier_version_has_no_identity_to_compare(tmp_path):
    check_expert(Run(tmp_path, Config()), holding(1.0))
    check_expert(Run(tmp_path, Config()), None)


@pytest.mark.parametrize("content", ["", "[]", '{"module": "a"}', '{"module": 3}'])
def test_an_identity_that_cannot_be_read_is_named(tmp_path, content):
    run = Run(tmp_path, Config())
    run.expert_path.write_text(content)
    with pytest.raises(RunError, match=r"expert\.json cannot be read: .*or delete it"):
        check_expert(run, holding(1.0))


def test_of_a_plan_that_is_not_repeatable_is_warned(tmp_path):
    run = Run(tmp_path, Config())
    count = itertools.count()
    with pytest.warns(UserWarning, match="gives another plan when it is asked again"):
        remember_expert(run, lambda *given: holding(next(count))(*given))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        remember_expert(run, holding(1.0))


def test_of_an_expert_that_fails_when_it_is_asked_first_is_warned_by_its_failure(tmp_path):
    count = itertools.count()

    def slow(*given):
        if next(count) == 0:
            raise TimeoutError("it compiles")
        return holding(1.0)(*given)

    with pytest.warns(UserWarning, match=r"slow gave no plan \(TimeoutError\) when it was asked"):
        remember_expert(Run(tmp_path, Config()), slow)


def test_beside_a_run_of_an_own_expert_that_of_the_package_is_not_measured_silently(tmp_path):
    run = Run(tmp_path, Config())
    run.append_metrics(collected_record(0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_own_expert(run)
    run.append_metrics(collected_record(1, expert="my_plan"))
    with pytest.warns(UserWarning, match="your own expert my_plan, but the expert that"):
        warn_of_own_expert(run)


def test_an_expert_that_has_changed_in_another_gait_is_refused(tmp_path):
    run = Run(tmp_path, with_gaits(Config(), ["trot", "bound"]))

    def of_two_gaits(torque):
        return lambda state, tick, command: holding(torque * command.gait)(state, tick, command)

    remember_expert(run, of_two_gaits(1.0))
    check_expert(run, of_two_gaits(1.0))
    with pytest.raises(RunError, match="at fixed state 3 of 3 its torque is up to 1 N m apart"):
        check_expert(run, of_two_gaits(2.0))
