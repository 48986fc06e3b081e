"""The command evaluate: a policy, and the expert beside it, on the same initial states.

It prints an `EvaluationReport` (`surefoot.evaluation.report`) and writes it as JSON.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from surefoot.cli.arguments import sort_arguments
from surefoot.cli.command_line import read_options
from surefoot.cli.evaluation_text import print_controller, print_differences, print_switching
from surefoot.cli.options import OnHardware, OnPushes, OnSimulator, OnTerrain, OnWorkers
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Config, DisturbanceConfig
from surefoot.config.json_io import changes
from surefoot.files import WriteError, write_json
from surefoot.mpc.gaits import only_gait
from surefoot.scenarios.starts import PACKAGED, load_starts, starts_of

if TYPE_CHECKING:
    from surefoot.evaluation.gaits import Switching
    from surefoot.evaluation.push_limits import PushResult
    from surefoot.evaluation.report import EvaluationReport
    from surefoot.evaluation.robustness import Robustness


@dataclass(frozen=True)
class Evaluate(OnPushes, OnWorkers, OnHardware, OnSimulator, OnTerrain):
    """Measure the robustness and tracking of a policy, and of the expert beside it.

    JSON keys: episodes, successes, success_rate, success_interval (Wilson, 95 %); falls, stalls,
    diverged, strict_successes; mse (successes) and settled_mse (all episodes, from 1 s on) of vx,
    vy [m^2/s^2] and yaw rate [rad^2/s^2]; max_torque [N m]; robot_seconds [s]; plans,
    invalid_plans; body_contacts (episodes in which something other than a foot touched the ground)
    and body_contact_successes; covered (successes that covered 70 % of the distance commanded);
    starts, starts_hash, split, initial_states (their ids, in order), outcomes, strict and touched
    (one digit for each of them) and lost_at [s]; latching (under a hardware profile: which robots
    would have switched themselves off, and which initial states lie outside it); policy (its file),
    simulator, terrain, disturbance (what disturbed the robots); success_difference, policy minus
    expert; mirror_error_mrad (how differently the policy treats left and right, in the initial
    states).

    A policy of several gaits is evaluated from the initial states of each of them; gaits has the
    results gait by gait, with on_speed (robots whose mean velocity is within 0.03 m/s or 20 % of
    the command) and error [m/s, m/s, rad/s]. Then robots change their gait six times in 20 s, by
    command: switching.

    With --pushes also: pushes, with fitted_impulse and max_impulse [N s] for each direction_deg,
    interval, their means, for each of the levels the successes of the episodes, and measured (the
    pushes asked for); and push_difference, policy minus expert. Under expert: the same keys of the
    expert. What was not measured is null.

    The folder of a run gets the report too, in a file named after what was evaluated, if all
    initial states and the expert were evaluated.
    """

    target: Annotated[Path | None, tyro.conf.Positional] = None
    """The folder of a run, of which the best policy is evaluated, or a policy file. Without one,
    the policy that comes with the package."""
    split: Literal["select", "test"] | None = None
    """The split of initial states to use, for the pushes too; without it, `test`, and for the
    pushes the split of the run's configuration. A policy is reported on `test`, once."""
    starts: str | None = None
    """The name of a set of initial states, or a file, instead of that of the run's configuration;
    solo12-trot-v1-wide is perturbed 1.5 times as far as solo12-trot-v1."""
    expert: bool = True
    """Evaluate the expert too."""
    pushes: bool = False
    """Push the robots too, and find the impulse that they withstand from each direction. By default
    100 robots walk for about 7 thousand seconds in all, with the policy and again with the expert;
    --push-speeds, --push-directions and --push-resolution make it shorter."""
    episodes: int | None = None
    """The number of initial states, spread over speeds and phases; without it, the number in the
    run's configuration."""
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """What makes the episodes harder: another friction or load, noise, late torques. What is not
    given on the command line is as in the run's configuration."""
    json: Path | None = None
    """Write the report to this file, as JSON."""

    def __call__(self) -> int:
        """Evaluate, write the report where asked, and print each result as soon as it is there."""
        from surefoot.evaluation.report import check_disturbances
        from surefoot.runs.own_expert import warn_of_own_expert
        from surefoot.runs.policies import find_policy
        from surefoot.runs.run import run_of_policy
        from surefoot.scenarios.gaits import all_starts_of
        from surefoot.scenarios.prepare import completed

        # What would fail after minutes fails before any work.
        check_outputs(self, [Output("--json", self.json)])
        self.check_pushed(self.pushes, "add --pushes")
        if self.starts is not None:
            load_starts(self.starts)
        policy, trained_on = find_policy(self.target)
        if self.starts is not None:
            only_gait(
                trained_on, "--starts", "leave --starts out, or evaluate a policy of one gait"
            )
        if self.pushes:
            only_gait(trained_on, "--pushes", "leave --pushes out, or push a policy of one gait")
        check_disturbances(self.as_asked(trained_on), trained_on.evaluation.disturbance)
        run = run_of_policy(policy)
        given = self.starts or trained_on.start_set
        if run is None and (self.expert or given is None):
            # Before the options, so that every simulator and ground has the same initial states.
            trained_on = completed(replace(trained_on, start_set=given))
        config = self.as_asked(trained_on)
        all_starts_of(config)
        if self.expert and run is not None:
            warn_of_own_expert(run)
        report = self.measure(policy, config)
        folder = self.target if self.target is not None and self.target.is_dir() else None
        if folder is not None and not (self.expert and self.episodes is None):
            print(
                "the run's folder keeps no copy of this report, nor will its page show it: leave "
                "out --no-expert and --episodes for that",
                file=sys.stderr,
            )
        elif folder is not None:
            copy = folder / self.file_name(config, trained_on)
            try:
                write_json(copy, report)
            except WriteError as error:  # of a run that may only be read
                print(f"no copy of the report in the run's folder: {error}", file=sys.stderr)
        return 0

    def measure(self, policy: Path, config: Config) -> EvaluationReport:
        """Evaluate a policy, and the expert if it was asked for; write and print the results.

        They are written first: what cannot be printed is not lost.

        Args:
            policy: File of the policy.
            config: What is evaluated.
        """
        from surefoot.evaluation.mirror_error import mirror_error_in_starts
        from surefoot.evaluation.push_limits import push_difference
        from surefoot.evaluation.report import EvaluationReport, ExpertReport, disturbances
        from surefoot.evaluation.robustness import success_difference
        from surefoot.scenarios.gaits import all_starts_of

        robustness, pushes = self.measure_controller(policy, config)
        starts = all_starts_of(config).first(self.of_split, config.evaluation.episodes)
        report = EvaluationReport(
            **vars(robustness),
            policy=str(policy),
            simulator=config.simulation.backend,
            terrain=config.simulation.terrain,
            disturbance=disturbances(config),
            pushes=pushes,
            mirror_error_mrad=mirror_error_in_starts(config, policy, starts),
            switching=self.switching(policy, config),
        )
        self.write_report(report)
        print_controller("policy", robustness, pushes)
        if report.switching is not None:
            print_switching(report.switching)
        if report.mirror_error_mrad is not None:
            print(f"  left-right mirror error: {report.mirror_error_mrad:.1f} mrad")
        if not self.expert:
            return report
        expert, expert_pushes = self.measure_controller(None, config)
        if pushes is not None and expert_pushes is not None:
            report = replace(report, push_difference=push_difference(pushes, expert_pushes))
        report = replace(
            report,
            expert=ExpertReport(
                **vars(expert), pushes=expert_pushes, switching=self.switching(None, config)
            ),
            success_difference=success_difference(robustness, expert),
        )
        self.write_report(report)
        print_controller("expert", expert, expert_pushes)
        if report.expert is not None and report.expert.switching is not None:
            print_switching(report.expert.switching)
        print_differences(report)
        return report

    def write_report(self, report: EvaluationReport) -> None:
        """Write the report to the file that was asked for, if there is one."""
        if self.json is not None:
            write_json(self.json, report)

    def measure_controller(
        self, policy: Path | None, config: Config
    ) -> tuple[Robustness, PushResult | None]:
        """Evaluate a policy, or the expert; push it if that was asked for.

        Args:
            policy: File of the policy; None evaluates the expert.
            config: What is evaluated.
        """
        from surefoot.evaluation.push import push_recovery
        from surefoot.evaluation.robustness import evaluate

        robustness, _ = evaluate(config, policy, self.of_split, self.spread)
        pushes = None
        if self.pushes:
            pushes = push_recovery(config, policy, self.spread)
        return robustness, pushes

    def switching(self, policy: Path | None, config: Config) -> Switching | None:
        """What becomes of robots that change their gait; None with one gait.

        Args:
            policy: File of the policy; None evaluates the expert.
            config: What is evaluated.
        """
        from surefoot.evaluation.gaits import evaluate_switching

        if not config.other_gaits:
            return None
        return evaluate_switching(config, policy, self.of_split, self.spread)

    @property
    def of_split(self) -> Literal["select", "test"]:
        """The split of the initial states."""
        return self.split or "test"

    def as_asked(self, config: Config) -> Config:
        """A run's configuration with what the options change."""
        evaluation = config.evaluation
        if self.episodes is not None:
            evaluation = replace(evaluation, episodes=self.episodes)
        evaluation = replace(evaluation, disturbance=self.disturbance)
        push = self.shortened(config.push)
        if self.split is not None:
            push = replace(push, split=self.split)
        start_set = config.start_set if self.starts is None else self.starts
        asked = replace(config, evaluation=evaluation, push=push, start_set=start_set)
        return self.on_terrain(self.with_profile(self.simulated(asked)))

    def file_name(self, config: Config, trained_on: Config) -> str:
        """Name of the report in the run's folder: what differs from the run's own evaluation.

        Args:
            config: What is evaluated.
            trained_on: The run's configuration.
        """
        from surefoot.evaluation.report import disturbances
        from surefoot.scenarios.keys import key_of

        parts: list[str] = [self.of_split]
        if config.simulation.backend != trained_on.simulation.backend:
            parts.append(config.simulation.backend)
        if config.simulation.terrain != trained_on.simulation.terrain:
            parts.append(re.sub(r"[^\w.]+", "_", config.simulation.terrain or "level"))
        robot = config.robot
        if robot.profile is not None and (robot.profile, robot.profile_spec) != (
            trained_on.robot.profile,
            trained_on.robot.profile_spec,
        ):
            parts.append(re.sub(r"[^\w.]+", "_", f"profile_{robot.profile}"))
            if robot.profile_spec is not None:  # a name says nothing of what a file holds
                parts[-1] += f"_{key_of(robot.profile_spec)[:8]}"
        if config.start_set != trained_on.start_set:
            if config.start_set in PACKAGED:
                parts.append(config.start_set)
            else:  # a name says nothing of what a file holds
                stored = starts_of(config)
                parts.append(f"{stored.name}_{stored.hash[:8]}")
        disturbed = disturbances(config)
        if disturbed != disturbances(trained_on):
            if not disturbed:
                parts.append("undisturbed")
            for name, value in disturbed.items():
                numbers = value if isinstance(value, tuple) else (value,)
                parts.append("_".join([name, *(f"{number:g}" for number in numbers)]))
        if self.pushes:
            pushed_on = config.push.split
            parts.append("pushes" if pushed_on == self.of_split else f"pushes_{pushed_on}")
            short = changes(replace(config.push, split=trained_on.push.split), trained_on.push)
            parts.extend(f"{name}_{value:g}" for name, value, _ in short)
        return f"evaluation-{'-'.join(parts)}.json"


def parse_evaluate(args: Sequence[str]) -> Evaluate:
    """The command that an argument list asks for; options change the run's own disturbance.

    An option counts because it was given, not because it differs from its default: the defaults are
    those of the run, so that ``--disturbance.delay 0`` switches a run's own delay off.

    Args:
        args: Command line, without the name of the command.

    Raises:
        RunError: The run's configuration cannot be read.
        SystemExit: Help was asked for, or an option is wrong.
    """
    arguments = sort_arguments(args, Evaluate)
    default = None
    if arguments.positional:
        target = Path(arguments.positional[0])
        default = Evaluate(target, disturbance=own_disturbance(target))
    return read_options(Evaluate, args, "surefoot evaluate", default)


def own_disturbance(target: Path) -> DisturbanceConfig:
    """What disturbs a run's own evaluation; nothing outside of any run.

    Args:
        target: Folder of a run, or a policy file; what is neither is refused later.
    """
    from surefoot.runs.layout import CONFIG_FILE
    from surefoot.runs.run import open_run, run_of_policy

    if (target / CONFIG_FILE).exists():
        return open_run(target).config.evaluation.disturbance
    run = run_of_policy(target)
    return DisturbanceConfig() if run is None else run.config.evaluation.disturbance
