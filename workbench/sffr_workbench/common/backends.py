"""Where many independent jobs run: processes of this machine, or the nodes of a Ray or Dask cluster.

Each job is a call of one function with plain arguments. It may run twice, if the node that it ran on is lost.
"""

from __future__ import annotations

import itertools
import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

from sffr_gym import ConfigError
from sffr_workbench.common.extras import require
from sffr_workbench.common.processes import end_with_parent, interrupts_ignored

LOKY, RAY, DASK = "loky", "ray", "dask"
MODULES = {LOKY: "joblib", RAY: "ray", DASK: "distributed"}  # by the backend's name
RETRIES = 5  # of a job whose node is lost
AHEAD = 4  # jobs for each processor of a cluster that wait there, so that none stands idle

Job = tuple[Any, ...]


class WorkersLost(Exception):
    """Worker processes died, and their jobs with them."""


@dataclass(frozen=True)
class Backend:
    """What runs jobs.

    Raises:
        ConfigError: for an unknown name, one that is not installed, or an address that it cannot have.
    """

    name: str = LOKY  #: ``loky`` for processes of this machine, ``ray`` or ``dask``
    address: str | None = None  #: of a cluster's head or scheduler; None to start one on this machine

    def __post_init__(self) -> None:
        """Check what was given."""
        if self.name not in MODULES:
            raise ConfigError(f"backend {self.name!r}: must be one of {', '.join(MODULES)}")
        if self.address is not None and self.name == LOKY:
            raise ConfigError(f"address = {self.address}: is that of a cluster; add --backend ray or dask")
        if self.name != LOKY:
            require("cluster", MODULES[self.name])

    @property
    def shares_files(self) -> bool:
        """Whether workers surely see the files of this process."""
        return self.name == LOKY

    def run(self, function: Callable[..., Any], jobs: Sequence[Job], workers: int) -> Iterator[Any]:
        """Yield what ``function(*job)`` returns for each job, in the order in which they are finished.

        Args:
            function: of a module that every worker can import.
            jobs: arguments of each call.
            workers: processes on this machine; a cluster that is given by its address uses all that it has.

        Raises:
            WorkersLost: if processes died, on a cluster more often than it tries again.
            ConfigError: if there is no cluster at the address.
            Exception: what a job raised.
        """
        workers = max(min(workers, len(jobs)), 1)
        run = {LOKY: _run_in_processes, RAY: _run_on_ray, DASK: _run_on_dask}[self.name]
        return run(function, jobs, workers, self.address) if jobs else iter(())


def _run_in_processes(function: Callable[..., Any], jobs: Sequence[Job], workers: int, _: str | None) -> Iterator[Any]:
    from joblib import Parallel, delayed  # here, since it takes long to load and most commands do without

    own = {"initializer": end_with_parent, "initargs": (os.getpid(),)} if workers > 1 else {}
    parallel = Parallel(n_jobs=workers, return_as="generator_unordered", **own)
    with interrupts_ignored():
        started = parallel(delayed(function)(*job) for job in jobs)
    try:
        with closing(started) as finished:
            yield from finished
    except BrokenProcessPool as error:
        raise WorkersLost from error


def _run_on_ray(function: Callable[..., Any], jobs: Sequence[Job], workers: int, address: str | None) -> Iterator[Any]:
    import ray
    from ray.exceptions import RayError, RayTaskError

    own: dict[str, Any] = {} if address else {"num_cpus": workers, "include_dashboard": False}
    with interrupts_ignored(), _same_sigterm():
        try:
            ray.init(address=address or "local", log_to_driver=False, logging_level=logging.ERROR, **own)
        except (ConnectionError, ValueError, RuntimeError) as error:
            advice = "; if its head asks for a token, set RAY_AUTH_MODE=token" if address else ""
            raise ConfigError(f"address = {address}: no Ray cluster answers: {_first_line(error)}{advice}") from None
    try:
        task = ray.remote(function).options(num_cpus=1, max_retries=RETRIES, scheduling_strategy="SPREAD")
        waiting = iter(jobs)
        capacity = AHEAD * max(int(ray.cluster_resources().get("CPU", 1)), 1)
        running = [task.remote(*job) for job in itertools.islice(waiting, capacity)]
        while running:
            (done,), running = ray.wait(running, num_returns=1)
            running += [task.remote(*job) for job in itertools.islice(waiting, 1)]
            yield ray.get(done)
    except RayTaskError as error:
        raise error.cause from None
    except RayError as error:
        raise WorkersLost from error
    finally:
        ray.shutdown()


def _run_on_dask(function: Callable[..., Any], jobs: Sequence[Job], workers: int, address: str | None) -> Iterator[Any]:
    from distributed import Client, KilledWorker, LocalCluster, as_completed

    with interrupts_ignored():
        try:
            cluster = address or LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
            client = Client(cluster, timeout="20s")
        except (OSError, TimeoutError, ValueError) as error:
            raise ConfigError(f"address = {address}: no Dask scheduler answers: {_first_line(error)}") from None
    try:
        waiting = iter(jobs)
        capacity = AHEAD * max(len(client.ncores()), 1)
        first = [client.submit(function, *job, pure=False) for job in itertools.islice(waiting, capacity)]
        finished = as_completed(first)
        for future in finished:
            for job in itertools.islice(waiting, 1):
                finished.add(client.submit(function, *job, pure=False))
            yield future.result()
    except KilledWorker as error:
        raise WorkersLost from error
    finally:
        client.close()
        if not isinstance(cluster, str):
            cluster.close()


@contextmanager
def _same_sigterm() -> Iterator[None]:
    """Keep what SIGTERM does, which Ray would change."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
