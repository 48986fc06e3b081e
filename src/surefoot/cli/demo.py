"""The command demo: trains a policy, measures it beside the expert, and films it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from surefoot.cli.evaluate import parse_evaluate
from surefoot.cli.options import OnRobot, OnWorkers
from surefoot.cli.play import Play
from surefoot.cli.train import parse_train
from surefoot.runs.layout import CONFIG_FILE

RUN = Path("runs/demo")
"""The folder of the demo's run; that of another robot has its name at the end."""


@dataclass(frozen=True)
class Demo(OnRobot, OnWorkers):
    """Train a policy in a few minutes, measure it beside the expert, and film it.

    This is the whole pipeline, small: the expert walks and is cloned, two iterations of
    LocoSafeDAGGER follow, and the best policy is evaluated on 100 initial states that it has never
    seen, next to the expert, and filmed. The same command goes on after a kill, and repeats of a
    finished demo only the evaluation and the film.
    """

    run: Path | None = None
    """The folder of the run; without it, runs/demo, or runs/demo-ROBOT."""

    def __call__(self) -> int:
        """Do the three steps; the first that fails gives the exit status."""
        folder = self.run or self.own_folder
        spread = ["--workers", str(self.workers), "--backend", self.backend]
        if self.ray_address is not None:
            spread += ["--ray-address", self.ray_address]
        robot = [] if self.robot is None else ["--robot", self.robot]
        train = ["loco_safe_dagger", "--preset", "quick", "--run", str(folder)]
        if (folder / CONFIG_FILE).exists():
            train.append("--resume")
        print("1 of 3: train a policy (surefoot train)", flush=True)
        status = parse_train([*train, *robot, *spread])()
        if status:
            return status
        print("\n2 of 3: measure it, and the expert (surefoot evaluate)", flush=True)
        status = parse_evaluate([str(folder), *spread])()
        if status:
            return status
        print("\n3 of 3: let it walk, and film it (surefoot play)", flush=True)
        status = Play(folder)()
        where = quote(str(folder))
        same = "" if self.robot is None else f" --robot {quote(self.robot)}"
        print(
            f"\n{folder} holds the data, the policies, metrics.jsonl, curves.png and the film.\n"
            f"Go on with: surefoot play {where} --vx 0.3\n"
            f"            surefoot view {where}           (in the browser; needs the extra viz)\n"
            f"            surefoot report {where}         (a model card)\n"
            f"            surefoot train loco_safe_dagger{same}  (10 to 15 minutes, better)"
        )
        return status

    @property
    def own_folder(self) -> Path:
        """The folder of the run, where none is named."""
        if self.robot is None or self.robot == "solo12":
            return RUN
        return RUN.with_name(f"{RUN.name}-{Path(self.robot).stem}")
