"""Every number a run depends on, as frozen dataclasses with units and sources.

"Paper" is *Safe Learning of Locomotion Skills from MPC* (Pua and Khadiv); "BiConMP" is Meduri et
al., T-RO 2023, and its public trot for Solo12. Durations are in seconds here, and in ticks of 1 ms
everywhere else. The command line, its help and the saved JSON all come from these classes, which
check themselves when they are made (`surefoot.config.checked`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

from surefoot.config.budget import BudgetConfig
from surefoot.config.checked import Checked, Within
from surefoot.config.commands import CommandBox
from surefoot.config.evaluation import EvaluationConfig, PushConfig
from surefoot.config.learning import (
    Device,
    HeightRule,
    LayoutName,
    MirrorChoice,
    MirrorName,
    NumberFormat,
    Phase,
    PolicyConfig,
    Precision,
    Schedule,
    Steps,
    TrainingConfig,
)
from surefoot.config.methods import (
    METHODS,
    BehaviorCloningConfig,
    DaggerConfig,
    DartConfig,
    ExpertData,
    IterativeConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    MethodConfig,
    SafeDaggerConfig,
    method_config,
)
from surefoot.config.mpc import (
    CentroidalConfig,
    ExpertConfig,
    FootholdRule,
    Gait,
    KinematicConfig,
    OtherGait,
)
from surefoot.config.robots import RobotConfig
from surefoot.config.safety import TABLE_I, GateName, HandBack, SafetyConfig
from surefoot.config.scenarios import (
    DisturbanceConfig,
    PerturbationConfig,
    Split,
    StateNoiseConfig,
    TeachingSplit,
)
from surefoot.config.sim import Backend, SimulationConfig

__all__ = [
    "METHODS",
    "MOST_GAITS",
    "TABLE_I",
    "Backend",
    "BehaviorCloningConfig",
    "BudgetConfig",
    "CentroidalConfig",
    "CommandBox",
    "Config",
    "DaggerConfig",
    "DartConfig",
    "Device",
    "DisturbanceConfig",
    "EvaluationConfig",
    "ExpertConfig",
    "ExpertData",
    "FootholdRule",
    "Gait",
    "GateName",
    "HandBack",
    "HeightRule",
    "IterativeConfig",
    "KinematicConfig",
    "LayoutName",
    "LocoDaggerConfig",
    "LocoSafeDaggerConfig",
    "MethodConfig",
    "MirrorChoice",
    "MirrorName",
    "NumberFormat",
    "OtherGait",
    "PerturbationConfig",
    "Phase",
    "PolicyConfig",
    "Precision",
    "PushConfig",
    "RobotConfig",
    "SafeDaggerConfig",
    "SafetyConfig",
    "Schedule",
    "SimulationConfig",
    "Split",
    "StateNoiseConfig",
    "Steps",
    "TeachingSplit",
    "TrainingConfig",
    "method_config",
    "simulated",
]


MOST_GAITS = 16
"""Maximum number of gaits of a policy, because each has a table with a row for each tick."""


@dataclass(frozen=True)
class Config(Checked):
    """Everything that fixes a result, apart from the versions of the packages that compute it.

    Raises:
        ValueError: A field is out of its range, there are more than `MOST_GAITS` gaits, or one of
            them is there twice.
    """

    method: MethodConfig = field(default_factory=LocoSafeDaggerConfig)
    seed: Annotated[int, Within(0, 2**63 - 1)] = 0
    """Root of all randomness."""
    chunk: Annotated[int, Within(1, 10_000)] = 10
    """Robots simulated together; also the unit of work that is spread over processes."""
    robot: RobotConfig = field(default_factory=RobotConfig)
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    gait: Gait = field(default_factory=Gait)
    other_gaits: tuple[OtherGait, ...] = ()
    """What else one policy walks by command, besides `gait`; made by `--gaits`."""
    switches: Annotated[int, Within(0, 1000)] = 2
    """How often a robot changes its gait in each episode that is learned from, if there are several
    gaits: from any of them to any other one, at any time."""
    commands: CommandBox = field(default_factory=CommandBox)
    expert: ExpertConfig = field(default_factory=ExpertConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)
    start_set: str | None = None
    """The initial states of rollouts and evaluations: the name of a set that comes with the
    package, or a file that `surefoot prepare --out` has written. None is the set of the configured
    robot, gait and commands: `solo12-trot-v1` for Solo12's trot straight ahead, and else the one
    that is prepared for them."""
    starts: TeachingSplit = "train"
    """Where all rollouts begin that are learned from, the expert's and those of iterations: in
    perturbed states (paper), or in the `nominal` ones of a settled gait cycle, ten phases at twenty
    commands, as on a robot that is never disturbed. There each command and phase has one state."""
    collection: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """Disturbances while data is collected, by behavior cloning or in iterations. `gentle` has no
    meaning for behavior cloning, and `expert_impulse` only has one for LocoDAGGER and
    LocoSafeDAGGER."""
    pretraining: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """Disturbances in the pre-training of iterative methods, none by default. Its `gentle` and
    `expert_impulse` have no meaning there: pre-training is one iteration, without tails."""
    budget: BudgetConfig = field(default_factory=BudgetConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    push: PushConfig = field(default_factory=PushConfig)

    def __post_init__(self) -> None:
        """Check all fields, and the gaits together."""
        super().__post_init__()
        if len(self.gaits) > MOST_GAITS:
            raise ValueError(
                f"other_gaits makes {len(self.gaits)} gaits; use at most {MOST_GAITS}, with `gait`"
            )
        numbers: dict[tuple[object, ...], int] = {}
        for number, gait in enumerate(self.gaits):
            first = numbers.setdefault(gait.timing, number)
            if first < number:
                raise ValueError(
                    f"other_gaits: the gaits number {first} and {number} have the same timing "
                    f"{gait.timing}; a gait is known by its timing, name each of them once"
                )

    @property
    def gaits(self) -> tuple[Gait, ...]:
        """All gaits: the first one and the others, in the order of their numbers."""
        return (self.gait, *(other.gait for other in self.other_gaits))


def simulated(config: Config, backend: Backend) -> Config:
    """The configuration, on another simulator."""
    return replace(config, simulation=replace(config.simulation, backend=backend))
