"""Calls in several processes of this machine, or on a Dask cluster, by joblib.

The workers of a cluster must have patagium installed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from patagium.errors import ParameterError


@contextmanager
def pool(jobs: int | None, cluster: str | None) -> Iterator[Any]:
    """Workers of joblib, processes of one thread each or a cluster, which give results in order.

    Args:
        jobs: Number of processes; None: one for each core. A cluster uses all its workers.
        cluster: Address of a Dask scheduler, such as tcp://10.0.0.1:8786; None: this machine.

    Raises:
        ParameterError: If the jobs are below one, or dask.distributed is not installed.
    """
    from joblib import Parallel, cpu_count, parallel_config

    if jobs is not None and jobs < 1:
        raise ParameterError("jobs", "a whole number of at least 1", jobs)
    order = {"return_as": "generator", "batch_size": 1}
    if cluster is None:
        with parallel_config("loky", n_jobs=jobs or cpu_count(), inner_max_num_threads=1):
            yield Parallel(**order)
        return
    with _client(cluster) as client, parallel_config("dask", client=client):
        yield Parallel(**order)


def _client(cluster: str) -> Any:
    try:
        distributed = import_module("distributed")
    except ImportError:
        raise ParameterError(
            "cluster", "dask.distributed to be installed: pip install 'patagium[cluster]'", cluster
        ) from None
    return distributed.Client(cluster, set_as_default=False)
