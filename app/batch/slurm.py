"""Workers as jobs of Slurm, which dask-jobqueue submits: as many as orders are left, and anew when a job's time is over.

What is not said on the command line is taken from dask's configuration (`jobqueue.slurm` in ~/.config/dask/*.yaml), as are the site's
own directives, prologue and network interface. A worker ends itself before its job's walltime (sbatch(1), --time): its child
stops at its next step, and the session goes on elsewhere.
"""

import math
import re
import shutil
import subprocess
from dataclasses import dataclass
from typing import Any

from app.batch.orders import BatchError

WORKER_GB = 0.5
"""Of a job's memory, besides the largest session's: dask's worker."""
MOST_MARGIN_S = 300.0
MARGIN = 0.1
"""Of a walltime, in which a worker ends in order."""


@dataclass(frozen=True, slots=True)
class Slurm:
    """What a job asks for; None: as dask's configuration has it."""

    partition: str | None = None
    account: str | None = None
    walltime: str | None = None
    cores: int | None = None


def seconds_of(walltime: str) -> float:
    """Of a time as sbatch(1) takes it: minutes, minutes:seconds, hours:minutes:seconds, days-hours[:minutes[:seconds]]."""
    found = re.fullmatch(r"(?:(\d+)-)?(\d+)(?::(\d+))?(?::(\d+))?", walltime.strip())
    if found is None:
        raise BatchError(
            f"--walltime {walltime}: is no time that Slurm takes; give it as 4:00:00 or 1-12:00:00"
        )
    days, *parts = (int(part) if part else None for part in found.groups())
    first, second, third = parts
    if days is not None or third is not None:
        hours, minutes, rest = first, second or 0, third or 0
    else:
        hours, minutes, rest = 0, first, second or 0
    return float((days or 0) * 86400 + (hours or 0) * 3600 + (minutes or 0) * 60 + rest)


def lifetime_s(walltime: str) -> float:
    """How long a worker works in a job of that walltime."""
    whole = seconds_of(walltime)
    return whole - min(MARGIN * whole, MOST_MARGIN_S)


def open_cluster(asked: Slurm, jobs: int, memory_gb: float, token: str) -> tuple[Any, float]:
    """A cluster of so many jobs at most, and how long each of its workers works, in seconds.

    Raises:
        BatchError: dask-jobqueue is not installed, there is no Slurm, or Slurm refuses such a job.
    """
    try:
        from dask import config
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError as error:
        raise BatchError(
            f"--slurm needs dask-jobqueue ({error}); install it with `pip install 'roomlight[batch]'`"
        ) from None
    if shutil.which("sbatch") is None:
        raise BatchError(
            "--slurm: there is no sbatch here; give the command on a machine that submits Slurm's jobs"
        )
    site = config.get("jobqueue.slurm")
    walltime, cores = asked.walltime or site["walltime"], asked.cores or site["cores"]
    if not cores:
        raise BatchError(
            "--slurm: say with --cores N how many cores a job gets, or as jobqueue.slurm.cores in ~/.config/dask"
        )
    lifetime = lifetime_s(walltime)
    extra = [
        "--resources",
        f"{token}={memory_gb:.3f}",
        "--lifetime",
        f"{lifetime:.0f}s",
        *site["worker-extra-args"],
    ]
    cluster = SLURMCluster(
        queue=asked.partition, account=asked.account, walltime=walltime, job_cpu=cores, cores=1, processes=1,
        memory=f"{math.ceil(memory_gb * 1e9)} B", worker_extra_args=extra, silence_logs="critical",
        scheduler_options={"dashboard_address": "127.0.0.1:0", **site["scheduler-options"]},
    )  # fmt: skip
    try:
        answer = subprocess.run(
            ["sbatch", "--test-only"], input=cluster.job_script(), capture_output=True, text=True, check=False
        )
        if answer.returncode:
            told = " ".join(answer.stderr.split()).removeprefix("sbatch: error: ")
            raise BatchError(
                f"--slurm: Slurm refuses such a job ({told}); mind --partition, --account, --walltime, --cores and --memory"
            )
    except BaseException:
        cluster.close()
        raise
    cluster.adapt(minimum=0, maximum=jobs)
    return cluster, lifetime
