"""Distill a model predictive controller into a 1 kHz neural policy for a legged robot, safely.

This is the whole public API. A name is imported when it is first used, so that `import surefoot`
takes no time and learning runs where there is no robotics stack. The table below says in which
module to read about each name; `__init__.pyi` repeats it for editors and type checkers. The
configurations of the parts are in `surefoot.config`. Read `surefoot.types` next.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from surefoot.caches import settle_caches as _settle_caches

_settle_caches()

_HOME = {
    "config": ("Config", "HandBack"),
    "config.robots": ("RobotSpec",),
    "config.presets": ("preset",),
    "config.expert_rules": ("published_rules",),
    "types": ("Command", "State", "MotionPlan", "Controller"),
    "robots.model": ("RobotModel", "standing"),
    "robots.solo12": ("solo12",),
    "robots.load": ("load_robot",),
    "robots.scaling": ("with_own_values",),
    "mpc.planner": ("Planner",),
    "mpc.expert": ("Expert", "make_expert"),
    "sim": ("Simulator", "make_simulator"),
    "scenarios.starts": ("Starts", "at_rest", "load_starts"),
    "scenarios.perturbation": ("perturb",),
    "safety.gates": ("Gate", "Bounds", "AnyOf"),
    "safety.monitor": ("SafetyMonitor",),
    "rollouts.outcome": ("Outcome",),
    "rollouts.arbiters": ("Arbiter", "ExpertOnly", "PolicyOnly", "RandomMix", "SafetySwitch"),
    "scenarios.disturbance": ("Disturbance", "Pushes"),
    "rollouts.episodes": ("Episodes", "Rollout"),
    "rollouts.engine": ("rollout",),
    "learning.dataset": ("Dataset",),
    "learning.frames": ("Frames",),
    "learning.observation": ("ObservationSpec",),
    "learning.network": ("PolicyNetwork",),
    "learning.policy": ("Policy", "PolicySpec", "policy_spec", "load", "save"),
    "learning.train": ("fit",),
    "workers": ("Workers",),
    "runs.run": ("Run", "create", "open_run"),
    "methods.behavior_cloning": ("behavior_cloning",),
    "methods.dagger": ("dagger",),
    "methods.safe_dagger": ("safe_dagger",),
    "methods.loco_dagger": ("loco_dagger",),
    "methods.loco_safe_dagger": ("loco_safe_dagger",),
    "methods.dart": ("dart",),
    "evaluation.robustness": ("evaluate", "Robustness"),
    "evaluation.push": ("push_recovery",),
    "evaluation.push_limits": ("push_difference", "PushResult"),
    "study.comparison": ("compare", "Measurements"),
    "evaluation.statistics": ("paired_difference", "run_interval"),
    "interop.gym.ids": ("register_environments",),
    "interop.datasets.arrays": ("frames_from_arrays", "read_expert_log"),
    "interop.socket_plan": ("SocketPlan", "serve_plan"),
    "interop.datasets.minari": ("export_minari",),
    "interop.datasets.lerobot": ("export_lerobot",),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__version__ = "0.1.0"
__all__ = sorted(_MODULE)


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"surefoot has no {name!r}; it has {', '.join(__all__)}")
    return getattr(import_module(f"surefoot.{_MODULE[name]}"), name)


def __dir__() -> list[str]:
    return __all__
