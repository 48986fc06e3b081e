"""What tests ask of a run: all the bits it leaves behind, and the record of a stage."""

from surefoot.runs.run import Run


def fingerprint(run: Run) -> dict:
    """All bits that a run leaves behind, apart from how long things took."""
    metrics = [{k: v for k, v in line.items() if k != "seconds"} for line in run.metrics]
    networks = {
        str(path.relative_to(run.folder)): path.read_bytes()
        for part in ("policies", "gates")
        for path in sorted((run.folder / part).glob("*"))
    }
    return {"data": run.dataset.hash, "metrics": metrics, **networks}


def figures_of(run: Run, stage: str, iteration: int) -> dict:
    """The record of a stage that is done."""
    done = run.done(stage, iteration)
    assert done is not None
    return done
