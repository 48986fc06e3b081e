"""What tests ask of a run: the bits it leaves behind, its records; and records made by hand."""

from dataclasses import replace

from surefoot.config.json_io import to_json
from surefoot.runs.metrics import (
    Best,
    Collected,
    GateTrained,
    LearnedGate,
    StageRecord,
    Trained,
    Validated,
)
from surefoot.runs.run import Run


def stages_of(run: Run) -> list[tuple[str, int]]:
    """Name and iteration of each stage that is done."""
    return [(record.stage, record.iteration) for record in run.metrics]


def measurements(run: Run) -> list[dict]:
    """The metrics apart from how long things took."""
    lines = [to_json(record) for record in run.metrics]
    return [{key: value for key, value in line.items() if key != "seconds"} for line in lines]


def fingerprint(run: Run) -> dict:
    """All bits that a run leaves behind, apart from how long things took."""
    networks = {
        str(path.relative_to(run.folder)): path.read_bytes()
        for part in ("policies", "gates")
        for path in sorted((run.folder / part).glob("*"))
    }
    return {"data": run.dataset.hash, "metrics": measurements(run), **networks}


def collected(run: Run, iteration: int) -> Collected:
    record = run.collected(iteration)
    assert record is not None
    return record


def trained(run: Run, iteration: int) -> Trained:
    record = run.trained(iteration)
    assert record is not None
    return record


def gate_trained(run: Run, kind: LearnedGate, iteration: int) -> GateTrained:
    record = run.gate_trained(kind, iteration)
    assert record is not None
    return record


def best(run: Run) -> Best:
    assert run.best is not None
    return run.best


# --- records made by hand


def collected_record(iteration: int, **changes) -> Collected:
    record = Collected(
        iteration=iteration,
        episodes=40,
        falls=0,
        falls_in_tail=0,
        falls_expert_driving=0,
        falls_expert_driving_before=0,
        near_falls=0,
        near_falls_in_tail=0,
        diverged=0,
        stalls=0,
        falls_per_robot_minute=0.0,
        takeovers=0,
        expert_share=1.0,
        expert_share_with_tail=1.0,
        failed_episodes=(),
        queries=0,
        queries_failed=0,
        expert_seconds=200.0,
        robot_seconds=200.0,
        plans=4000,
        invalid_plans=0,
        frames_kept=200_000,
        recoveries_tilted=0,
        recoveries_near_bounds=0,
        expert="surefoot.mpc.planner",
        starts_hash="28d8",
        dataset_frames=200_000,
        dataset_hash="ee92",
        seconds=10.0,
    )
    return replace(record, **changes)


def trained_record(iteration: int, **changes) -> Trained:
    record = Trained(
        iteration=iteration,
        epochs=12,
        steps=7000,
        frames=200_000,
        device="cpu",
        train_loss=0.01,
        validation_loss=0.02,
        seconds=40.0,
    )
    return replace(record, **changes)


def validated_record(iteration: int, **changes) -> Validated:
    record = Validated(
        iteration=iteration,
        starts="solo12-trot-v1",
        starts_hash="28d8",
        split="select",
        episodes=100,
        successes=90,
        success_rate=0.9,
        success_interval=(0.83, 0.94),
        falls=6,
        stalls=4,
        diverged=0,
        strict_successes=88,
        mse=(0.001, 0.002, 0.003),
        settled_mse=(0.001, 0.002, 0.003),
        max_torque=2.5,
        robot_seconds=480.0,
        plans=0,
        invalid_plans=0,
        seconds=12.0,
    )
    return replace(record, **changes)


def gate_record(kind: LearnedGate, iteration: int, **changes) -> GateTrained:
    record = GateTrained(
        stage="gate_classifier" if kind == "classifier" else "gate_history",
        iteration=iteration,
        rows=1000,
        share_yes=0.1,
        seed=7,
        seconds=1.5,
    )
    return replace(record, **changes)


EVERY_RECORD: list[StageRecord] = [
    collected_record(0),
    trained_record(0),
    gate_record("classifier", 0, tau=3.5, sigma=(0.5,) * 12, sha256="ab"),
    gate_record("history", 1, held_out=10, held_out_yes=2, alarm=0.5, recall=0.5, precision=1.0),
    validated_record(1, mse=(None, None, None)),
    Best(best_iteration=1),
]
"""One of each kind, with and without what may be left out."""
