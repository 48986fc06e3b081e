"""The public API for editors and type checkers; `__init__.py` imports the same names lazily.

`tests/test_api.py` holds both lists together.
"""

from surefoot.config import Config as Config
from surefoot.config import HandBack as HandBack
from surefoot.config.expert_rules import published_rules as published_rules
from surefoot.config.presets import preset as preset
from surefoot.config.robots import RobotSpec as RobotSpec
from surefoot.evaluation.push import push_recovery as push_recovery
from surefoot.evaluation.push_limits import PushResult as PushResult
from surefoot.evaluation.push_limits import push_difference as push_difference
from surefoot.evaluation.robustness import Robustness as Robustness
from surefoot.evaluation.robustness import evaluate as evaluate
from surefoot.evaluation.statistics import paired_difference as paired_difference
from surefoot.evaluation.statistics import run_interval as run_interval
from surefoot.interop.datasets.arrays import frames_from_arrays as frames_from_arrays
from surefoot.interop.datasets.arrays import read_expert_log as read_expert_log
from surefoot.interop.datasets.lerobot import export_lerobot as export_lerobot
from surefoot.interop.datasets.minari import export_minari as export_minari
from surefoot.interop.gym.ids import register_environments as register_environments
from surefoot.interop.socket_plan import SocketPlan as SocketPlan
from surefoot.interop.socket_plan import serve_plan as serve_plan
from surefoot.learning.dataset import Dataset as Dataset
from surefoot.learning.frames import Frames as Frames
from surefoot.learning.network import PolicyNetwork as PolicyNetwork
from surefoot.learning.observation import ObservationSpec as ObservationSpec
from surefoot.learning.policy import Policy as Policy
from surefoot.learning.policy import PolicySpec as PolicySpec
from surefoot.learning.policy import load as load
from surefoot.learning.policy import policy_spec as policy_spec
from surefoot.learning.policy import save as save
from surefoot.learning.train import fit as fit
from surefoot.methods.behavior_cloning import behavior_cloning as behavior_cloning
from surefoot.methods.dagger import dagger as dagger
from surefoot.methods.dart import dart as dart
from surefoot.methods.loco_dagger import loco_dagger as loco_dagger
from surefoot.methods.loco_safe_dagger import loco_safe_dagger as loco_safe_dagger
from surefoot.methods.safe_dagger import safe_dagger as safe_dagger
from surefoot.mpc.expert import Expert as Expert
from surefoot.mpc.expert import make_expert as make_expert
from surefoot.mpc.planner import Planner as Planner
from surefoot.robots.load import load_robot as load_robot
from surefoot.robots.model import RobotModel as RobotModel
from surefoot.robots.model import standing as standing
from surefoot.robots.scaling import with_own_values as with_own_values
from surefoot.robots.solo12 import solo12 as solo12
from surefoot.rollouts.arbiters import Arbiter as Arbiter
from surefoot.rollouts.arbiters import ExpertOnly as ExpertOnly
from surefoot.rollouts.arbiters import PolicyOnly as PolicyOnly
from surefoot.rollouts.arbiters import RandomMix as RandomMix
from surefoot.rollouts.arbiters import SafetySwitch as SafetySwitch
from surefoot.rollouts.engine import rollout as rollout
from surefoot.rollouts.episodes import Episodes as Episodes
from surefoot.rollouts.episodes import Rollout as Rollout
from surefoot.rollouts.outcome import Outcome as Outcome
from surefoot.runs.run import Run as Run
from surefoot.runs.run import create as create
from surefoot.runs.run import open_run as open_run
from surefoot.safety.gates import AnyOf as AnyOf
from surefoot.safety.gates import Bounds as Bounds
from surefoot.safety.gates import Gate as Gate
from surefoot.safety.monitor import SafetyMonitor as SafetyMonitor
from surefoot.scenarios.disturbance import Disturbance as Disturbance
from surefoot.scenarios.disturbance import Pushes as Pushes
from surefoot.scenarios.perturbation import perturb as perturb
from surefoot.scenarios.starts import Starts as Starts
from surefoot.scenarios.starts import at_rest as at_rest
from surefoot.scenarios.starts import load_starts as load_starts
from surefoot.sim import Simulator as Simulator
from surefoot.sim import make_simulator as make_simulator
from surefoot.study.comparison import Measurements as Measurements
from surefoot.study.comparison import compare as compare
from surefoot.types import Command as Command
from surefoot.types import Controller as Controller
from surefoot.types import MotionPlan as MotionPlan
from surefoot.types import State as State
from surefoot.workers import Workers as Workers

__version__: str
__all__: list[str]
