"""A user's own MPC as the expert of a run, whose folder keeps its identity in ``expert.json``.

The run continues only with the same expert. Read `mpc.identity` for what the identity is.
"""

from __future__ import annotations

import warnings

from surefoot.config.json_io import from_json, read_json
from surefoot.files import write_json
from surefoot.mpc.identity import ExpertIdentity, difference, identity_of
from surefoot.robots.load import load_robot
from surefoot.rollouts.jobs import PLANNER
from surefoot.runs.layout import RunError
from surefoot.runs.metrics import Collected
from surefoot.runs.run import Run
from surefoot.types import PlanFunction


def remember_expert(run: Run, plan: PlanFunction | None) -> None:
    """Keep the identity of a user's MPC in the folder of a run that has not begun.

    The package's own planner is fixed by the run's configuration, and leaves no file.

    Args:
        run: The run.
        plan: The expert's MPC; None for the BiConMP-style planner.

    Raises:
        WriteError: The file cannot be written.
    """
    if plan is None:
        run.expert_path.unlink(missing_ok=True)  # left by an MPC that has collected nothing
    else:
        write_json(run.expert_path, _identity(run, plan))


def check_expert(run: Run, plan: PlanFunction | None) -> None:
    """Check that an MPC is the one that a run was begun with.

    Runs of earlier versions stored no identity: for them, the stages only compare the names.

    Args:
        run: The run.
        plan: The expert's MPC; None for the BiConMP-style planner.

    Raises:
        RunError: It is another MPC, or the file with the identity cannot be read.
    """
    if not run.expert_path.exists():
        return
    try:
        before = from_json(ExpertIdentity, read_json(run.expert_path))
    except ValueError as error:
        raise RunError(
            f"{run.expert_path} cannot be read: {error}. Restore it from a copy, or delete it: "
            "then the run knows its expert by its name alone"
        ) from error
    if plan is None:
        text = "not with the package's own planner"
    else:
        text = difference(before, _identity(run, plan))
    if text:
        raise RunError(
            f"{run.folder} was begun with the expert {before.title}, {text}. Resume it with the "
            "same one, or begin another run"
        )


def warn_of_own_expert(run: Run) -> None:
    """Warn if a run learned from a user's MPC, although the package's planner is measured."""
    names = {record.expert for record in run.metrics if isinstance(record, Collected)}
    for name in sorted(names - {PLANNER}):
        warnings.warn(
            f"{run.folder} learned from your own expert {name}, but the expert that is measured "
            "here is the package's planner: use sf.evaluate and sf.push_recovery with your plan, "
            "from Python, or leave the expert out with --no-expert",
            stacklevel=3,
        )


def _identity(run: Run, plan: PlanFunction) -> ExpertIdentity:
    """The identity of a user's MPC; warns if the same state gives another plan a second time."""
    identity = identity_of(plan, load_robot(run.config.robot), len(run.config.gaits))
    failure = identity.plans[0].failure
    if not identity.repeatable and failure:
        warnings.warn(
            f"the expert {identity.name} {failure} when it was asked first, and answered "
            "otherwise for the same state: a resumed run knows it by its name alone. If it begins "
            "slowly, let it plan once before the run begins",
            stacklevel=4,
        )
    elif not identity.repeatable:
        warnings.warn(
            f"the expert {identity.name} gives another plan when it is asked again for the same "
            "state: results depend on the order of the work, and a resumed run knows it by its "
            "name alone. Make it a pure function (surefoot.testing.PlanContract tests that)",
            stacklevel=4,
        )
    return identity
