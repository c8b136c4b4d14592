"""What is sent to a worker, by value: it has to run, and say so, where there is no Roomlight or another one.

Nothing of the program is imported before its text was found to be ours.
"""

from collections.abc import Mapping
from typing import Any


def unfit(program: str) -> str:
    """Why this process cannot work for a program of that name (`app.sources.program`); "" where it can."""
    try:
        from app.sources import program as ours
    except ImportError as error:
        return (
            f"has no Roomlight that can be used ({error}); install the version that the batch is started with"
        )
    if ours() == program:
        return ""
    return f"has another version of Roomlight ({ours()}, the batch {program}); install the same on both"


def run(
    order: Mapping[str, Any], program: str, batch: str, surroundings: Mapping[str, Any]
) -> Mapping[str, Any]:
    """Do one order in a child, where this worker is fit to; plain values in, plain values out."""
    refusal = unfit(program)
    if refusal:
        from distributed import get_worker

        return {"unfit": refusal, "worker": get_worker().address}
    from app.batch import child

    return child.run(batch, order, surroundings)


async def stop(program: str, batch: str) -> None:
    """End a batch's children here, and wait until they have; a coroutine, which keeps no worker from its work."""
    if not unfit(program):
        from app.batch import child

        await child.stop(batch)
