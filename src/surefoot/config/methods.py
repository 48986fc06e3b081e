"""The methods' parameters, as frozen dataclasses: the paper's numbers, in its symbols.

Part of `config`, where the rest stands.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from surefoot.config.safety import HandBack


@dataclass(frozen=True)
class ExpertData:
    """Expert rollouts to clone: velocities x phases x perturbations, and nominal ones."""

    velocities: int
    """Equally spaced forward speeds."""
    perturbations: int
    """Perturbed starts for each velocity and each of the ten phases of the gait cycle."""
    nominal: bool
    """Also one unperturbed rollout for each velocity, from standing still."""
    duration: float
    """[s] of each rollout."""


@dataclass(frozen=True)
class BehaviorCloningConfig:
    """Behaviour cloning (paper, II-A and IV-E)."""

    name: ClassVar[str] = "behavior_cloning"

    data: ExpertData = field(default_factory=lambda: ExpertData(20, 2, False, 3.0))
    """400 x 3 s (paper, IV-F)."""
    epochs: int = 150
    """(paper, IV-F)."""
    frames: tuple[int, ...] = ()
    """A series of dataset sizes: a policy of its own for each, trained on the first whole episodes
    with at most so many frames. The last policy has all frames."""


@dataclass(frozen=True)
class DaggerConfig:
    """DAGGER (Ross et al., 2011; paper, Algorithm 1)."""

    name: ClassVar[str] = "dagger"

    pretraining: ExpertData = field(default_factory=lambda: ExpertData(10, 1, True, 1.5))
    """What i = 1 collects: with beta_1 = 1 it is the expert alone. As the other methods have it."""
    pretraining_epochs: int = 150
    """of i = 1."""
    iterations: int = 10
    """Iterations after that."""
    velocities: int = 10
    """Rollouts of an iteration: velocities x one random phase x perturbations."""
    perturbations: int = 1
    """Stored perturbations of each velocity in an iteration, drawn anew each time."""
    T: float = 5.0
    """[s] of a rollout."""
    p: float = 0.5
    """beta_i = p^(i-1) (Ross et al.): the share of steps that the expert drives."""
    epochs: int = 15
    """of an iteration."""


@dataclass(frozen=True)
class SafeDaggerConfig:
    """SafeDAGGER (Zhang and Cho, 2016; paper, Algorithm 2)."""

    name: ClassVar[str] = "safe_dagger"

    pretraining: ExpertData = field(default_factory=lambda: ExpertData(10, 1, True, 1.5))
    """As the other methods have it."""
    pretraining_epochs: int = 150
    """As for behaviour cloning."""
    iterations: int = 10
    """N"""
    velocities: int = 20
    """Rollouts of an iteration: velocities x one random phase x perturbations."""
    perturbations: int = 2
    """Stored perturbations of each velocity in an iteration, drawn anew each time."""
    T: float = 5.0
    """[s] of a rollout."""
    unsafe_share: float = 0.2
    """tau is chosen so that the policy deviates by more than tau from the expert in this share of
    the held-out pre-training frames (Zhang and Cho)."""
    epochs: int = 15
    """of an iteration."""


@dataclass(frozen=True)
class LocoDaggerConfig:
    """LocoDAGGER (paper, Algorithm 3 and IV-E)."""

    name: ClassVar[str] = "loco_dagger"

    pretraining: ExpertData = field(default_factory=lambda: ExpertData(10, 1, True, 1.5))
    """10 velocities x (1 nominal + 10 perturbed) x 1.5 s (paper, IV-E)."""
    pretraining_epochs: int = 150
    """As for behaviour cloning; the paper does not say."""
    iterations: int = 10
    """N (paper)."""
    velocities: int = 10
    """Rollouts of an iteration: velocities x one random phase x perturbations; 10 (paper)."""
    perturbations: int = 1
    """Stored perturbations of each velocity in an iteration, drawn anew each time."""
    T: float = 5.0
    """[s] of a rollout (paper)."""
    alpha: float = 0.5
    """Decay of the expert's influence: it drives a period of 50 ms with probability alpha^(i-1);
    the paper tries 0.5 and 0.8."""
    N_query: int = 5
    """Expert rollouts from states of each rollout (paper)."""
    T_query: float = 1.0
    """[s] of each of them (paper)."""
    before_fall: float = 0.2
    """[s] states are sampled at the latest so long before a failure."""
    epochs: int = 15
    """of an iteration (paper)."""


Guard = Literal["bounds", "relaxing", "classifier", "history"]
"""Gates: `bounds`, the paper's table; `relaxing`, the same, tight at first and as in the table in
the last iteration; `classifier`, SafeDAGGER's; `history`, a network that predicts from the last 100
ms that the bounds will be left within 0.3 s (the second and the last are the paper's future work).
Networks guard from the iteration after the first data they can learn from."""


@dataclass(frozen=True)
class LocoSafeDaggerConfig:
    """LocoSafeDAGGER (paper, Algorithm 4 and IV-E)."""

    name: ClassVar[str] = "loco_safe_dagger"

    pretraining: ExpertData = field(default_factory=lambda: ExpertData(10, 1, True, 1.5))
    """10 velocities x (1 nominal + 10 perturbed) x 1.5 s (paper, IV-E)."""
    pretraining_epochs: int = 150
    """As for behaviour cloning; the paper does not say."""
    iterations: int = 10
    """N (paper)."""
    velocities: int = 20
    """Rollouts of an iteration: velocities x one random phase x perturbations."""
    perturbations: int = 2
    """Stored perturbations of each velocity in an iteration, drawn anew each time."""
    T: float = 10.0
    """[s] of a rollout (paper)."""
    T_block: float = 2.0
    """[s] the expert drives at least, once it has taken over (paper)."""
    T_end: float = 1.0
    """[s] of the expert's tail after a rollout (paper)."""
    hand_back: HandBack = "safe_and_blocked"
    """When the policy drives again after a takeover: see `HandBack`."""
    guard: tuple[Guard, ...] = ("bounds",)
    """Who calls a state unsafe; of several, any of them. See `Guard`."""
    tightest: float = 0.6
    """Of the relaxing bounds in the first iteration, as a share of the paper's."""
    alarm: float = 0.5
    """Probability at which the history network, or the classifier, calls a state unsafe. The
    network's are calibrated, and bounds are rarely left: 0.2 costs as many false takeovers as
    bounds tightened to 0.6, and announces more falls (``benchmarks/README.md``)."""
    epochs: int = 15
    """of an iteration (paper)."""


IterativeConfig = DaggerConfig | SafeDaggerConfig | LocoDaggerConfig | LocoSafeDaggerConfig
MethodConfig = BehaviorCloningConfig | IterativeConfig

METHODS: dict[str, type[MethodConfig]] = {
    kind.name: kind
    for kind in (
        BehaviorCloningConfig,
        DaggerConfig,
        SafeDaggerConfig,
        LocoDaggerConfig,
        LocoSafeDaggerConfig,
    )
}
"""Methods and their parameters, in the paper's order."""
