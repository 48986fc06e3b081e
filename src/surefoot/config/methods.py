"""The methods' parameters as frozen dataclasses: the paper's numbers, in its symbols.

The iterative methods share `IterativeConfig`: a pre-training on expert rollouts, then
iterations that collect and train. The methods themselves are in `surefoot.methods`, one file each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from surefoot.config.checked import Checked, Duration, Seconds, Share, Within
from surefoot.config.learning import Steps
from surefoot.config.safety import HISTORY_HORIZON, GateName, HandBack
from surefoot.errors import unknown

Epochs = Annotated[int, Within(1, 1_000_000)]
"""Passes over the data."""
StepCount = Annotated[int, Within(1, 1_000_000_000)]
"""Steps of the optimizer."""
Count = Annotated[int, Within(1, 10_000)]
"""How many commands or perturbations of the stored initial states are used."""
CountOrNone = Annotated[int, Within(0, 10_000)]
"""The same, or none of them."""


@dataclass(frozen=True)
class ExpertData(Checked):
    """Expert rollouts to clone: commands x phases x perturbations, and nominal ones."""

    section: ClassVar[str] = "expert_data"

    velocities: Count
    """How many commands are used, spread over all that there are; forward speeds are equally
    spaced."""
    perturbations: CountOrNone
    """How many perturbed initial states there are for each command and each phase of the gait cycle
    (a trot has ten); at most 1 from `nominal` starts. 0 leaves the rollouts from standing alone."""
    nominal: bool
    """Add one unperturbed rollout for each command, from standing still, whatever `starts` is."""
    duration: Duration
    """[s] how long a rollout lasts; in one shorter than `safety.grace` no fall is seen."""

    def __post_init__(self) -> None:
        """Check the fields, and that there is a rollout at all."""
        super().__post_init__()
        if self.perturbations == 0 and not self.nominal:
            raise ValueError(
                "expert data of 0 perturbations without nominal rollouts is no data: use nominal "
                "rollouts, or 1 perturbation or more"
            )


@dataclass(frozen=True)
class BehaviorCloningConfig(Checked):
    """Behavior cloning (paper, II-A and IV-E)."""

    name: ClassVar[str] = "behavior_cloning"
    section: ClassVar[str] = "method"

    data: ExpertData = field(default_factory=lambda: ExpertData(20, 2, False, 3.0))
    """400 rollouts of 3 s (paper, IV-F)."""
    epochs: Epochs = 150
    """Passes over the data (paper, IV-F)."""
    steps: StepCount | None = None
    """Steps of the optimizer in each training, instead of `epochs`: as many as another method
    takes, however much data there is."""
    frames: Annotated[tuple[int, ...], Within(1, 1_000_000_000_000)] = ()
    """A series of dataset sizes: each gives a policy that is trained on whole episodes with at most
    this many frames, the first ones in a random order that is fixed by the seed and mixes the
    phases."""
    all_frames: bool = True
    """The last policy is trained on all frames; if not, the series ends with the largest size of
    `frames`, which has to be its last one."""

    def __post_init__(self) -> None:
        """Check the fields, and that the series ends with its largest size."""
        super().__post_init__()
        if self.all_frames:
            return
        if not self.frames:
            raise ValueError(
                "method.frames is empty, and without method.all_frames there is nothing to train "
                "on; name a size"
            )
        if max(self.frames) != self.frames[-1]:
            raise ValueError(
                f"method.frames is {self.frames}; without method.all_frames the last size, whose "
                "policy is the run's best, has to be the largest"
            )

    @property
    def training(self) -> int | Steps:
        """How long each training lasts: a number of passes over the data, or of steps."""
        return self.epochs if self.steps is None else Steps(self.steps)

    @property
    def sizes(self) -> int:
        """How many policies the series has."""
        return len(self.frames) + self.all_frames


@dataclass(frozen=True)
class IterativeConfig(Checked):
    """What all methods share that alternate between rollouts and training."""

    name: ClassVar[str]
    section: ClassVar[str] = "method"
    teaches: ClassVar[bool] = False
    """Whether the expert also drives in order to teach, in queries or in a tail."""

    pretraining: ExpertData = field(default_factory=lambda: ExpertData(10, 1, True, 1.5))
    """The expert's rollouts to begin with: 10 velocities x (1 nominal + 10 perturbed) x 1.5 s. The
    paper (IV-E) has 100 rollouts from 10 velocities; the ten nominal ones, from standing, are added
    here. They are the same for all methods, and DAGGER's i = 1, as beta_1 = 1."""
    pretraining_epochs: Epochs = 150
    """Passes over the data of the pre-training: as many as for behavior cloning, because the paper
    does not say."""
    iterations: Annotated[int, Within(0, 10_000)] = 10
    """N, the iterations after the pre-training (paper)."""
    velocities: Count = 10
    """Rollouts of an iteration: commands x one random phase x perturbations (paper: 10 rollouts
    for LocoDAGGER)."""
    perturbations: Count = 1
    """How many stored perturbations of each command an iteration draws, anew each time; from
    `nominal` starts, how many of the phases."""
    T: Duration = 5.0
    """[s] how long a rollout lasts (paper)."""
    epochs: Epochs = 15
    """Passes over the data in an iteration (paper); in the last one alone, where there are
    `steps_before_last`."""
    pretraining_steps: StepCount | None = None
    """Steps of the optimizer in the pre-training, instead of `pretraining_epochs`."""
    steps: StepCount | None = None
    """Steps of the optimizer in an iteration, instead of `epochs`; in the last one alone, where
    there are `steps_before_last`."""
    steps_before_last: StepCount | None = None
    """Steps of the optimizer in every iteration before the last, while data are still to come;
    without it, each trains as long as the last one (paper)."""

    def training_in(self, iteration: int) -> int | Steps:
        """How long the training of an iteration lasts: a number of passes over the data, or steps.

        Args:
            iteration: The iteration i; 0 is the pre-training.
        """
        if iteration == 0:
            return self.first_training
        if iteration < self.iterations and self.steps_before_last is not None:
            return Steps(self.steps_before_last)
        return self.training

    @property
    def first_training(self) -> int | Steps:
        """How long the pre-training lasts: a number of passes over the data, or of steps."""
        if self.pretraining_steps is None:
            return self.pretraining_epochs
        return Steps(self.pretraining_steps)

    @property
    def training(self) -> int | Steps:
        """How long the training of the last iteration lasts: passes over the data, or steps."""
        return self.epochs if self.steps is None else Steps(self.steps)


@dataclass(frozen=True)
class DaggerConfig(IterativeConfig):
    """DAGGER (Ross et al., 2011; paper, Algorithm 1)."""

    name: ClassVar[str] = "dagger"

    p: Share = 0.5
    """The expert drives a step of the run's iteration i with probability p^i. Ross et al. count the
    pre-training as their first iteration, and so write beta_i = p^(i-1)."""


@dataclass(frozen=True)
class SafeDaggerConfig(IterativeConfig):
    """SafeDAGGER (Zhang and Cho, 2016; paper, Algorithm 2)."""

    name: ClassVar[str] = "safe_dagger"

    velocities: Count = 20
    perturbations: Count = 2
    unsafe_share: Share = 0.2
    """tau is chosen so that the policy deviates by more than tau from the expert in this share of
    the held-out pre-training frames (Zhang and Cho)."""


@dataclass(frozen=True)
class LocoDaggerConfig(IterativeConfig):
    """LocoDAGGER (paper, Algorithm 3 and IV-E)."""

    name: ClassVar[str] = "loco_dagger"
    teaches: ClassVar[bool] = True

    alpha: Share = 0.5
    """Decay of the expert's influence: it drives a period of 50 ms with probability alpha^(i-1);
    the paper tries 0.5 and 0.8."""
    N_query: Annotated[int, Within(1, 600)] = 5
    """Expert rollouts from different states of each rollout (paper); fewer if it ended early."""
    T_query: Duration = 1.0
    """[s] how long each of them lasts (paper); one shorter than `safety.grace` never fails."""
    before_fall: Seconds = 0.2
    """[s] how long before a failure the states are sampled at the latest."""


@dataclass(frozen=True)
class LocoSafeDaggerConfig(IterativeConfig):
    """LocoSafeDAGGER (paper, Algorithm 4 and IV-E)."""

    name: ClassVar[str] = "loco_safe_dagger"
    teaches: ClassVar[bool] = True
    renamed: ClassVar[Mapping[str, str]] = {"guard": "gates"}

    velocities: Count = 20
    perturbations: Count = 2
    T: Duration = 10.0
    T_block: Seconds = 2.0
    """[s] how long the expert drives at least, once it has taken over (paper)."""
    T_end: Seconds = 1.0
    """[s] how long the expert's tail after a rollout lasts (paper)."""
    hand_back: HandBack = "safe_and_blocked"
    """When the policy drives again after a takeover: when the state is safe and T_block is over
    (the paper's research code), or safe or T_block over (its prose), or T_block over without a
    violation (its Algorithm 4)."""
    gates: tuple[GateName, ...] = ("bounds",)
    """The gates; a state is unsafe if any of them calls it so. `bounds` is the paper's table;
    `relaxing` is the same table, tight in the first iteration; `classifier` is a network that
    predicts deviations from the expert; `history` is one that predicts that the bounds will be
    left."""
    tightest: Share = 0.6
    """The relaxing bounds in the first iteration, as a share of the paper's."""
    alarm: Share = 0.5
    """Probability beyond which the history network, or the classifier, calls a state unsafe. The
    network's probabilities are calibrated, and bounds are rarely left: 0.2 costs as many false
    takeovers as bounds tightened to 0.6, and announces more falls
    (`benchmarks/notebook/gates.md`)."""

    def __post_init__(self) -> None:
        """Check the fields, and that a history network would have something to learn from."""
        super().__post_init__()
        if not self.gates:
            raise ValueError("method.gates is empty; name at least one gate, for example bounds")
        # In ticks of 1 ms, as rollouts count their time.
        if "history" in self.gates and round(1000 * self.T) <= round(1000 * HISTORY_HORIZON):
            raise ValueError(
                f"method.T is {self.T} s; a history network predicts {HISTORY_HORIZON} s ahead and "
                "learns from longer rollouts only"
            )


@dataclass(frozen=True)
class DartConfig(IterativeConfig):
    """DART (Laskey et al., 2017): the expert drives under noise of the size of the learner's error.

    The paper does not have it; the numbers of the rollouts are those of DAGGER.
    """

    name: ClassVar[str] = "dart"

    noise_scale: Annotated[float, Within(0.0, 1000.0)] = 1.0
    """Factor on the covariance of the learner's error in torque, from which the noise is drawn."""
    noise_hold: Annotated[float, Within(0.001, 60.0)] = 0.05
    """[s] how long a draw of the noise is held, one period of the MPC: white noise of 1 kHz would
    average out."""


MethodConfig = (
    BehaviorCloningConfig
    | DaggerConfig
    | SafeDaggerConfig
    | LocoDaggerConfig
    | LocoSafeDaggerConfig
    | DartConfig
)

METHODS: Mapping[str, type[MethodConfig]] = {
    kind.name: kind
    for kind in (
        BehaviorCloningConfig,
        DaggerConfig,
        SafeDaggerConfig,
        LocoDaggerConfig,
        LocoSafeDaggerConfig,
        DartConfig,
    )
}
"""Methods and their parameters, in the paper's order; DART is not in the paper."""


def blocking_of(method: MethodConfig) -> LocoSafeDaggerConfig:
    """The parameters of a takeover: the method's own, or the paper's if it has none."""
    return method if isinstance(method, LocoSafeDaggerConfig) else LocoSafeDaggerConfig()


def method_config(name: str) -> MethodConfig:
    """The paper's parameters of a method.

    Raises:
        ValueError: There is no such method.
    """
    if name not in METHODS:
        raise ValueError(unknown("method", name, METHODS))
    return METHODS[name]()
