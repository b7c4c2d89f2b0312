"""Shards made by the workers of a Dask cluster: one that is started here, or one that runs already.

Dask starts a shard again if its worker dies. That is safe: a shard has one lock, one commit, and the same bytes whoever
makes it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from waveformer.datagen.factory_shard import ShardMaker, ShardReceipt
from waveformer.simulator.errors import SetupError, WaveformerError

# Enough that no worker waits for the next shard.
_SHARDS_PER_WORKER = 2
# A shard whose workers died so often is not to blame for it: poison dies in the sandbox. The machine is.
_ALLOWED_DEATHS = 30
_ANSWER_WITHIN = "30s"

_makers: dict[str, ShardMaker] = {}


def make_on_cluster(
    root: Path, shards: Sequence[int], workers: int, scheduler: str | None
) -> Iterator[ShardReceipt]:
    """Receipts as shards are ready.

    Args:
        root: of the dataset, under the same path for all workers.
        shards: to be made.
        workers: to be started if there is no scheduler; one thread each.
        scheduler: address of a running one.

    Raises:
        StoreError, SetupError: as `ShardMaker.make`.
        SetupError: Dask is missing, the scheduler does not answer, or workers keep dying.
    """
    try:
        import distributed
    except ImportError as error:
        raise SetupError("several workers need dask: pip install distributed") from error

    with ExitStack() as stack:
        try:
            client = stack.enter_context(_client(distributed, stack, workers, scheduler))
        except (OSError, TimeoutError) as error:
            raise SetupError(
                f"the Dask scheduler {scheduler or 'of this machine'} does not answer: {error}"
            ) from error
        todo = iter(shards)
        limit = _SHARDS_PER_WORKER * max(workers, len(client.scheduler_info()["workers"]))
        ready = distributed.as_completed([], raise_errors=False)
        for _, shard in zip(range(limit), todo, strict=False):
            ready.add(_submit(client, root, shard))
        for future in ready:
            if future.status == "error":
                failure = future.exception()
                if isinstance(failure, WaveformerError):
                    raise failure
                raise SetupError(
                    f"workers of the cluster died or failed again and again: {failure}"
                ) from failure
            yield future.result()
            future.release()  # a result that is kept would be made again if its worker died
            for _, shard in zip(range(1), todo, strict=False):
                ready.add(_submit(client, root, shard))


def _client(distributed: Any, stack: ExitStack, workers: int, scheduler: str | None) -> Any:
    if scheduler is not None:
        return distributed.Client(scheduler, timeout=_ANSWER_WITHIN)
    import dask

    stack.enter_context(
        dask.config.set(
            {
                "distributed.scheduler.allowed-failures": _ALLOWED_DEATHS,
                "distributed.worker.daemon": True,
                # Looking at stacks a hundred times a second and at loops fifty times takes a seventh of a core.
                "distributed.worker.profile.enabled": False,
                "distributed.admin.tick.interval": "1s",
            }
        )
    )
    cluster = stack.enter_context(
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # its port may be another run's
            memory_limit=0,  # the sandbox has its own limit
            silence_logs=logging.CRITICAL,
        )
    )
    return distributed.Client(cluster)


def _submit(client: Any, root: Path, shard: int) -> Any:
    # impure: what a shard needs is in its folder, not in the arguments
    return client.submit(_make, str(root.resolve()), shard, pure=False, retries=0)


def _make(root: str, shard: int) -> ShardReceipt:
    """In a worker: one sandbox for all shards of a dataset."""
    if root not in _makers:
        _makers[root] = ShardMaker(Path(root))
    return _makers[root].make(shard)
