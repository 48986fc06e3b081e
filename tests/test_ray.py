"""Ray: the same bits as processes of one machine, also when a node of the cluster is lost."""

import fcntl
import os
import signal
import sys
import time
from dataclasses import replace

import pytest

from surefoot.methods.loco_safe_dagger import collection, loco_safe_dagger
from surefoot.rollouts.jobs import chunks_of, run_chunk
from surefoot.runs.run import create
from surefoot.runs.stages import collect_data
from surefoot.workers import RETRIES, Workers, each_chunk, map_chunks
from tests.fakes.runs import fingerprint, measurements
from tests.fakes.small_runs import RESCUING

ray = pytest.importorskip("ray", reason="the extra ray is not installed")
from ray._private.services import find_gcs_addresses  # noqa: E402
from ray.cluster_utils import Cluster  # noqa: E402

# Workers cannot import this file: its functions travel with the tasks.
ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])

RAY = Workers(2, "ray")
pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """No other process tests Ray: "auto" would find the cluster that its test has started."""
    with (tmp_path_factory.getbasetemp().parent / "ray.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture
def fresh(alone):
    """Ray is shut down before and after the test, and no cluster of another test is left."""
    ray.shutdown()
    for _ in range(300):
        if not find_gcs_addresses():
            break
        time.sleep(0.1)  # its processes take a while to end on a busy machine
    yield
    ray.shutdown()


def die_once(argument):
    number, folder = argument
    if number == 1 and not (folder / "died").exists():
        (folder / "died").touch()
        os._exit(3)
    return number


def always_die(argument):
    number, folder = argument
    if number == 1:
        (folder / f"{time.monotonic_ns()}.tried").touch()
        os._exit(3)
    return number


def refuse(number):
    raise LookupError(f"no chunk {number}")


def threads(_):
    return os.environ.get("OMP_NUM_THREADS")


def test_a_run_on_ray_has_the_bits_of_one_in_this_process(fresh, tmp_path, caplog):
    """And chunks whose worker dies are run again; errors come as they are."""
    handler = signal.getsignal(signal.SIGTERM)
    in_this_process = create(tmp_path / "in_this_process" / "run", RESCUING)
    on_ray = create(tmp_path / "on_ray" / "run", RESCUING)
    loco_safe_dagger(in_this_process, Workers(1))
    loco_safe_dagger(on_ray, RAY)
    assert fingerprint(in_this_process) == fingerprint(on_ray)
    assert map_chunks(refuse, [], RAY, "nothing to do") == []
    chunks = [(number, tmp_path) for number in range(4)]
    assert map_chunks(die_once, chunks, RAY, "dies once") == [0, 1, 2, 3]
    assert (tmp_path / "died").exists()
    assert "dies once: a worker died; run again: chunk 1\n" in caplog.text
    with pytest.raises(RuntimeError, match="always: a worker died 3 times while chunk 1 was in p"):
        map_chunks(always_die, chunks, RAY, "always")
    assert len(list(tmp_path.glob("*.tried"))) == RETRIES + 1
    with pytest.raises(LookupError, match="no chunk 0"):
        map_chunks(refuse, [0], RAY, "refuses")
    assert map_chunks(threads, [0], RAY, "threads") == ["1"]
    assert signal.getsignal(signal.SIGTERM) == handler  # Ray would take it over


def test_no_cluster_is_a_clear_error(fresh):
    with pytest.raises(ValueError, match=r"no Ray cluster at .*ray start --head"):
        map_chunks(threads, [0], Workers(1, "ray", "auto"), "nowhere")


def slowly(job, marks):
    mark = marks / f"{ray.get_runtime_context().get_node_id()}.{os.getpid()}"
    mark.touch()
    time.sleep(0.5)
    mark.unlink()
    return run_chunk(job)


def test_a_node_that_is_lost_costs_time_only(fresh, tmp_path, monkeypatch, caplog):
    """Two nodes of one core each; one is killed while both collect."""
    config = replace(RESCUING, chunk=2)
    undisturbed = create(tmp_path / "undisturbed", config)
    collect_data(undisturbed, 0, collection(undisturbed, 0), Workers(1))

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    lost = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    workers = Workers(2, "ray", cluster.address)
    marks = tmp_path / "marks"
    marks.mkdir()
    killed = []

    def kill(worker):
        """End node and worker as a loss of power does; a worker left may report its result."""
        raylet = lost.all_processes["raylet"][0].process
        for pid in (raylet.pid, worker):
            os.kill(pid, signal.SIGKILL)
        raylet.wait()
        killed.append(worker)

    def then_kill(function, chunks, workers, title):
        on_a_node = lambda job: slowly(job, marks)  # noqa: E731
        for done in each_chunk(on_a_node, chunks, workers, title):
            for _ in range(50):
                at_work = list(marks.glob(f"{lost.node_id}.*"))
                if at_work and not killed:
                    kill(int(at_work[0].suffix[1:]))
                time.sleep(0.0 if killed else 0.01)
            yield done

    monkeypatch.setattr("surefoot.runs.collecting.each_chunk", then_kill)
    disturbed = create(tmp_path / "disturbed", config)
    try:
        collect_data(disturbed, 0, collection(disturbed, 0), workers)
        assert killed
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert "collect: a worker died; run again: chunk" in caplog.text
    assert len(chunks_of(collection(disturbed, 0))) == 11
    assert disturbed.dataset.hash == undisturbed.dataset.hash
    assert measurements(disturbed) == measurements(undisturbed)
